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

/* The powers 1 ... n of pole/(s + pole) of one input u: z[j] + d[j] u, of n equal lags in a row, z' = phi' z + b u with
 * the phi of a path. Any path is a sum of them; b_of, start_of, d_of : what each power 0 ... n adds to a path. */
typedef struct {
    int64_t n;
    const double *phi, *b, *d, *start;        /* (n, n) upper triangular, (n,) each */
    const double *b_of, *start_of, *d_of;     /* (n + 1, n), (n + 1, n), (n + 1,) */
} TwinLags;

/* What may be wrong in the model, psi: twin/gap/model_error.py. The output error has the coefficients v of the powers of
 * the lags of q3, of theta_d and of friction's direction, and of a constant; each term adds to one of the four. */
typedef struct {
    TwinLags lags;
    int64_t masses, terms;
    const int64_t *powers;      /* (terms, 5) which of the four; powers of stiffness, damping, pitch; psi's factor or -1 */
    const double *term;        /* (terms, n + 1) */
    const double *deviations;  /* (3 + 5 + masses,) of gap, start, growth rad/s and psi; inf: any value */
    double presliding;         /* m */
} ModelError;

/* What the twin knows of the structure: twin/gap/observer.py. */
typedef struct {
    TwinPath from_q3, from_theta_d;
    int64_t settle;
    double sample_time, pitch, pole, noise_colour; /* s, m/rad, rad/s, 1 */
} TwinModel;

/* One buffer and the model that it is explained by. room (6 n,). With a twin that simulates: its cost and gradient into
 * out (3,), and its rows of error and derivatives by gap, start and growth rad/s into rows (4, counted); else null. */
typedef struct {
    const TwinModel *model;
    TwinBuffer data;
    const double *q3; /* (N,) m */
    double *room;
    void *simulation;
    void (*cost)(void *simulation, double half_gap, double theta_d0, double *out);
    void (*rows)(void *simulation, double half_gap, double theta_d0, double growth, double *rows);
    double *simulated; /* (4, counted) room */
} TwinProblem;

/* How the cost is minimised. other : another method than BFGS, else null: from x (2,), deg, to the best point; done (2,):
 * evaluations, and whether it converged. */
typedef struct {
    int64_t most; /* evaluations */
    double tolerance;
    void *method;
    void (*other)(void *method, double *x, int64_t *done);
} Optimizer;

/* how a search for the gap ended */
enum { ENDED, SPENT, STUCK, OTHERWISE, NO_END };

/* Outcome of one estimation, see twin/gap/estimate.py: rad, rad/s, m^2. */
typedef struct {
    double gap, fit_gap, theta_d0, cost, std, growth, growth_std;
    int64_t evaluations, converged, end;
} GapEstimate;

/* why an estimate goes to the controller or not */
enum {
    BETTER, AGREES, NO_BETTER, OUTSIDE, NOT_CONVERGED, NO_CONTACT, NOT_DETERMINED, ELSEWHERE, RIVAL_BETTER, RIVAL, UNGUARDED
};

/* What the guard asks for: twin/gap/guard.py; scan (scans,) : the half-gaps of the profile, rad. */
typedef struct {
    double gap_most, significance, shading, agreement, precise, travel, resolution; /* rad but for the two ratios */
    int64_t attempts, scans;
    const double *scan;
} GuardSettings;

/* One try: an estimate, the verdict on it, and the half-gap that goes to the controller, rad. about : the angle that the
 * reason is about, rad. */
typedef struct {
    GapEstimate estimate;
    int64_t accepted, settled, agrees, reason;
    double about, applied;
} GapAttempt;

/* The guard at work on a buffer against the half-gap in force, rad. eps_q (N,), profile (2, scans), other (2, scans):
 * room; scanned : whether the profile is there. */
typedef struct {
    const TwinProblem *problem;
    const ModelError *wrong;
    const GuardSettings *settings;
    double present;
    double *eps_q, *profile, *other;
    int64_t scanned;
} Guard;
