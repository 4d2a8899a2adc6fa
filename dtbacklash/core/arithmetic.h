/* Arithmetic that the files of the core and an exported controller share. */
/* For a function that is called with a constant size, so that its loops are unrolled. */
#define UNROLLED static inline __attribute__((always_inline))

static inline double dmin(double a, double b) { return b < a ? b : a; }
static inline double dmax(double a, double b) { return b > a ? b : a; }

static inline int64_t least_of(int64_t a, int64_t b) { return a < b ? a : b; }

/* The sign of a number: -1, 0 or 1. */
static inline int64_t sign_of(double value) { return (value > 0.0) - (value < 0.0); }

static inline void set_zero(double *target, int64_t n)
{
    for (int64_t i = 0; i < n; i++)
        target[i] = 0.0;
}

static inline void copy(const double *source, double *target, int64_t n)
{
    for (int64_t i = 0; i < n; i++)
        target[i] = source[i];
}

/* Next output of the play operator; Krasnosel'skii & Pokrovskii, Systems with Hysteresis (1989). rad -> rad. */
static inline double play(double theta_d, double theta_m, double half_gap)
{
    return dmin(dmax(theta_d, theta_m - half_gap), theta_m + half_gap);
}
