/* A designed controller and its state, see control/laws.py: matrices by rows. */

enum { IMC, NIMC, OPEN_LOOP, LINEAR };
enum { BARE, MEASURED, INNER_LOOP, EXACT, INVERSE };

/* entries of `inverse`: the inverse of the backlash as a share of the gap; W r, m; the gap of the model, rad; the
 * reference that passes, m; the samples for which the next one is held back */
enum { I_SHARE, I_AHEAD, I_GAP, I_REFERENCE, I_WAITING };

typedef struct {
    int64_t structure, model;
    int64_t n_w, n_m, n_s, n_law, n_moves; /* states of prefilter, motor, structure and linear law; planned moves */
    int64_t forwards;                      /* whether torques are fed forward */
    int64_t arriving, patience;            /* samples */
    double gain, sample_time, limit;       /* V/rad, s, V */
    double crossing_ratio, crossing_rate, crossing_step, catching, jump;
    double small_gap;     /* a smaller gap, rad, is crossed as if it were this large: the side that pushed is known */
    double near;          /* a held reference passes when the measured motor is this near to its model, rad */
    double catching_most; /* by so much what keeps it away is made up for at most, rad */
    int64_t search_steps; /* towards the moves of a predictive law in a sample, at most, */
    double found;         /* and the change, V, below which none follows */
    const double *wa, *wb, *wc; /* the prefilter: x' = wa x + wb r, y = wc x + wd r */
    double wd;
    const double *ma, *mb;                            /* the motor: current, speed, angle */
    const double *sa, *sb, *sc;                       /* the structure */
    const double *forward;                            /* (5,) V, 1/rad, phase, V s/rad, V */
    const double *w_rest, *s_rest;                    /* states at rest for one rad of the screw */
    const double *late;                               /* (3,) samples by which command and both sensors are late */
    const double *la, *lb, *lc, *ld, *le, *lh, *lf;   /* a linear law: control/linear_law.py */
    const double *search;                             /* (2,) length of a step and momentum */
} Controller;

typedef struct {
    int64_t delay; /* columns of `lines` */
    double *w, *m, *s;
    double *theta_d; /* (2,) the screw behind the model's motor, and behind the measured one, rad */
    double *spare, *angle, *w_r;
    double *inverse; /* (5,) */
    double *servo;   /* (3,) rad */
    double *lines;   /* (3, delay) values on their way, newest first */
    double *law;     /* (n_law,) */
    double *moves;   /* (2, n_moves) V */
} ControllerState;
