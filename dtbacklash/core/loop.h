/* What a closed loop runs on, see experiment/loop.py and twin/: signals and traces of N + 1 samples, by rows. */

/* why a segment ended; ALARM and the place of the index that has risen */
enum { RAN, NOVELTY, DIVERGED, ALARM = 10 };

/* places of the novelty indexes */
enum { FREQUENCY, MOTOR, STRUCTURE, N_INDEX };

typedef struct {
    int64_t samples, sensors;   /* N + 1 */
    int64_t noisy, ahead;       /* whether there is noise, and whether the reference is known ahead */
    const double *reference;    /* m, or V in open loop */
    const double *gap;          /* half-gap, rad */
    const double *noise;        /* (N + 1, sensors) SI */
    const double *resolution;   /* (sensors,) size of a count, 0 for none */
    const double *moving;       /* -1, 0 or 1, how the reference moves */
} Signals;

typedef struct {
    double *u, *theta_d, *gap_hat, *eps, *novelty; /* V, rad, rad, m, m */
    double *truth, *seen;                          /* (N + 1, sensors) SI */
} Traces;

/* A lock-in filter: its oscillator's step, its low pass in sections of six, and its state: twin/gap/novelty.py. */
typedef struct {
    int64_t sections;
    double cos_step, sin_step;
    const double *sos; /* (sections, 6) */
    double *state;     /* (2 + 4 sections + 2,) */
} LockIn;

/* sum a theta = sum b u + scale torque, the newest sample first: twin/bank/equation.py. */
typedef struct {
    const double *a, *b; /* (4,) */
    const double *known; /* (5,) friction N m, load N m, cogging N m, its periods a radian, its phase */
    double scale, keep, sample_time;
    double rest;         /* slower than this, rad/s, the rotor may be at rest: an encoder's counts are no motion */
} MotorEquation;

/* The novelty indexes and their state: twin/bank/indexes.py. */
typedef struct {
    MotorEquation motor;
    TwinPath from_q3, from_theta_d;
    double frequency, sample_time, keep, keep_turning, least_m;
    double *past, *lags, *by_q3, *by_theta_d, *theta_d, *phasor, *means, *armed, *begun;
    double *values;       /* (N + 1, 3) every index */
    const double *limits; /* (3,) */
    double hysteresis;
} Indexes;

/* A segment: the samples first <= k < stop. theta_m, q3 : sensors that show them, or -1. The half-gap in force is `gap`
 * rad at sample `since`, and grows by `growth` a sample. largest : |q3| that counts as diverged, m. novelty : m, ends
 * the segment where it rises through this; before : novelty of the sample before the first. */
typedef struct {
    int64_t first, stop, theta_m, q3, since;
    double gap, growth, largest, novelty, before;
} Segment;
