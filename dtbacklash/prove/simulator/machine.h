/* What the concealing simulator works on: a rig for one sampling time, and what changes while it is simulated.
 * Units are SI: an effort is in N where a body slides and in N m where it turns.
 */

/* ends of links and bristles that are not bodies */
enum { GROUND = -1, BASE = -2 };

/* columns of `body` */
enum { B_VISCOUS, B_DIFFERENCE, B_LEVELS, B_COGGING, B_WAVE, B_PHASE, B_LOAD, B_WEIGHT, B_ANGLE, N_BODY };

/* columns of `link`; the lever is how far its first end goes per unit of the motion of the body there */
enum {
    L_K,
    L_C,
    L_CUBIC,
    L_QUADRATIC,
    L_FORCE,
    L_YIELD,
    L_STOP,
    L_CLEARANCE,
    L_DRIFT,
    L_LOST,
    L_LEVER,
    L_LOSS,
    N_LINK
};

/* columns of `friction`; F_LOADED: 1 where the friction of what passes on an effort belongs to it */
enum { F_COULOMB, F_STRIBECK, F_SPEED, F_BRISTLE, F_DAMPING, F_LOADED, N_FRICTION };

/* entries of `drive`; D_EFFORT: N or N m per volt of an ideal actuator; D_TRAVEL: m per volt of a positioner */
enum {
    D_R,
    D_L,
    D_KT,
    D_KB,
    D_RIPPLE,
    D_PERIODS,
    D_PHASE,
    D_HEAT,
    D_TAU,
    D_LEAD,
    D_SHARE,
    D_BASE_MASS,
    D_PITCH,
    D_WAVE,
    D_SHIFT,
    D_GAP,
    D_GAIN,
    D_DEAD,
    D_LIMIT,
    D_DELAY,
    D_BODY,
    D_EFFORT,
    D_TRAVEL,
    D_LAG,
    D_HOLD,
    D_BRAKE,
    D_FAST,
    D_STRONG,
    D_LOSS,
    D_SCREW_LOSS,
    N_DRIVE
};

/* columns of `sensor` */
enum { Y_INDEX, Y_GAIN, Y_OFFSET, Y_DELAY, Y_NOISE, Y_COUNT, Y_PLACE, Y_OFF_CENTRE, Y_PHASE, N_SENSOR };

/* Y_INDEX of a sensor that shows no state: on the mass that a rigid screw carries; of the link, of the body Y_PLACE */
enum { BASE_POSITION = -1, BASE_VELOCITY = -2, LINK_FORCE = -3, ACCELERATION = -4 };

/* columns of `unknown`; U_PLACE: the body, link or sensor */
enum { U_KIND, U_PLACE, U_SIZE, U_SCALE, U_WAVE, U_PHASE, U_SECOND, U_SHIFT, N_UNKNOWN };

/* U_KIND: the physics that the catalogue does not have */
enum {
    POSITION_DAMPING,
    DISTURBANCE,
    DIRECTIONAL_TORQUE,
    ROOT_SPRING,
    SPEED_STIFFENING,
    ANGULAR_PLAY,
    POSITION_MASS,
    COLOURED_FORCE,
    DOUBLE_RIPPLE,
    WANDERING_FRICTION,
    CREEP,
    POSITION_GAIN,
    GAIN_DRIFT,
    INTERPOLATION,
    CURVED_SCALE,
    READING_DRIFT,
    CLOCK_JITTER
};

/* entries of `control`, and C_MODE; C_RATE: gain on the rate; C_CORNER: its filter, per sample */
enum { C_MODE, C_GAIN, C_FILTER, C_INTEGRAL, C_LIMIT, C_RATE, C_CORNER, N_CONTROL };
enum { OPEN, CASCADE, PID };

/* states of a controller: of its prefilter (two), its integral, and the filter of its rate */
enum { H_FIRST, H_SECOND, H_INTEGRAL, H_RATE, N_HELD };

/* entries of `scalar`; S_FROM to S_IMPOSED_RATE: how a positioner moves between two samples */
enum { S_HEAT, S_BASE, S_BASE_RATE, S_CONTACT, S_ON_BASE, S_FROM, S_SINCE, S_IMPOSED_RATE, N_SCALAR };

/* A rig, of whose bodies the first is the motor's rotor. Its state x is [current, screw's angle, positions, velocities
 * of the bodies]. */
typedef struct {
    int64_t bodies, links, frictions, sensors, unknowns, substeps;
    double sample_time;           /* s */
    const double *inertia;        /* (bodies,) */
    const double *body;           /* (bodies, N_BODY) */
    const double *link;           /* (links, N_LINK) */
    const int64_t *link_ends;     /* (links, 2) */
    const double *friction;       /* (frictions, N_FRICTION) */
    const int64_t *friction_ends; /* (frictions, 2) */
    const double *drive;          /* (N_DRIVE,) */
    const double *sensor;         /* (sensors, N_SENSOR) */
    const double *unknown;        /* (unknowns, N_UNKNOWN) */
} Machine;

/* State and room to work in; a memory is (state, displacement). */
typedef struct {
    double *x, *start, *trial, *total, *rates; /* (2 + 2 bodies,) */
    double *force;                             /* (bodies,) effort on each body */
    double *lost;                              /* (bodies,) friction of what passes on an effort there */
    double *bristle, *bristle_start;           /* (frictions, 2) memories now, and at the step's start */
    double *yielding_start;                    /* (links, 2) the same of links that yield */
    double *scalar;                            /* (N_SCALAR,) */
    double *control;                           /* (N_HELD,) */
    double *course; /* (3, unknowns) what follows a course of its own: now, and at both ends of a step */
} Memory;

/* The inputs of a run of N samples. */
typedef struct {
    int64_t samples;
    const double *control;   /* (N_CONTROL,) */
    const double *reference; /* (N,) m, or V in open loop */
    const double *dither;    /* (N,) added voltage */
    const double *courses;   /* (N, unknowns) */
    const double *noise;     /* (N, sensors) standard normal */
    const int64_t *roles;    /* (2,) the sensors that a controller looks at */
} Signals;

/* What sensors look at, step by step, for their delays: a ring of `depth` rows, (depth, sensors). */
typedef struct {
    int64_t depth, newest;
    double *seen;
} History;
