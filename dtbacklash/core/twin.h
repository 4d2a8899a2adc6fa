/* What the digital twin compares: a buffer of measurements, and the way of an angle or position to the output error. */

/* One input's way to the output error: x[k+1] = phi x[k] + b u[k], y[k] = x[k][0] + d u[k], by n lags. */
typedef struct {
    int64_t n;
    double d;
    const double *phi;   /* (n, n) upper triangular, by rows */
    const double *b;     /* (n,) */
    const double *start; /* (n,) the state at rest for a unit input */
} TwinPath;

/* A buffer of N samples, of which the cost counts those from `settle` on. */
typedef struct {
    int64_t samples, settle;
    const double *theta_m; /* (N,) the motor's angle, rad */
    const double *eps_q;   /* (N,) the output error without what comes by theta_d, m */
    TwinPath path;         /* from theta_d, rad, to the output error, m */
} TwinBuffer;
