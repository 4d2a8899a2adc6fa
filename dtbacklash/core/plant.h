/* What the simulation works on: a rig, compiled for one sampling time, and what changes while it is simulated.
 *
 * The continuous plant is x' = A x + G w with the state x = [i?, q (bodies), v (bodies), aux] and the channels w: the
 * voltage, the base's extra position and velocity, an effort on each body, a rate for each auxiliary state. Matrices
 * come in two versions: gear out of contact, and in contact.
 */

/* channels */
enum { CH_V, CH_D, CH_DD, CH_F };

/* ends of links and friction contacts that are not bodies */
enum { GROUND = -1, BASE = -2 };

/* states of the gear; PLUS and MINUS are contacts on that side, RIGID means that there is no gap */
enum { MINUS = -1, FREE, PLUS, RIGID };

/* columns of `link`; the lever is how far its first end goes per unit of the motion of the body there */
enum { L_K, L_C, L_LEVER, N_LINK };

/* entries of `circuit`: of a winding; an actuator; a servo, with the largest effort of its position loop, and all */
enum { C_R, C_KT, C_GAIN, C_POSITION, C_SPEED, C_ASKED, C_LARGEST, N_CIRCUIT };

/* entries of `screw`; the base's stiffness and damping are those that it feels while everything else stands */
enum { S_LEAD, S_SHARE, S_BASE_MASS, S_INERTIA, S_BASE_K, S_BASE_C, N_SCREW };

/* columns of `sensor`, and its index where it shows no state: of the base, of a link, of a body */
enum { Y_INDEX, Y_PLACE, N_SENSOR };
enum { BASE_POSITION = -1, BASE_VELOCITY = -2, LINK_FORCE = -3, ACCELERATION = -4 };

/* what a dry friction carries, where it is no link: nothing that matters, the effort of the drive, that of the screw */
enum { NOTHING = -1, DRIVE = -2, SCREW = -3 };

/* slots of the laws: what acts at body j, link j, contact j, sensor j; at the amplifier, winding and screw (j = 0) */
enum { BODY_EFFORT, BODY_MEMORY, LINK, FRICTION, READING, COMMAND, WINDING, MOTOR_TORQUE, LEAD, N_SLOTS };

/* a link has three places that follow one another: its play, its forces, and those with a memory */
enum { PLAYS, FORCES, MEMORIES, PER_LINK };

/* m gear modes, l step levels, n states, c channels; matrices by rows. */
typedef struct {
    int64_t n, channels, levels, substeps;
    int64_t bodies, links, frictions, sensors;
    int64_t position;     /* index of the first position in x */
    int64_t current;      /* index of the winding's current in x, or -1 */
    int64_t rotor;        /* the motor's rotor among the bodies, or -1 */
    int64_t driven;       /* the body that the drive drives, or -1 */
    int64_t lag;          /* index in x of what has arrived at an actuator that lags, or -1 */
    int64_t limited;      /* a servo has limits */
    int64_t loaded;       /* a dry friction depends on what its place carries */
    int64_t has_base;     /* a screw or a positioner drives the structure */
    int64_t imposed;      /* the motor's angle (or the positioner's command) is given instead of simulated */
    int64_t forced;       /* something besides the voltage and the gear acts */
    int64_t depth;        /* of what sensors have seen, samples */
    int64_t acts;         /* a bit for each slot in which a law stands */
    int64_t remembers;    /* a spring remembers */
    int64_t delay_whole;  /* the amplifier's delay: whole samples, */
    int64_t delay_ticks;  /* ticks (sample_time/substeps/2^(levels-1)), */
    double delay_part;    /* and a part of a tick */
    double sample_time;
    const double *E;      /* (m, l, n, n) transposed transition matrices over a step sample_time/substeps/2^level */
    const double *P1;     /* (m, l, c, n) responses to channels that are constant, */
    const double *P2;     /* and that rise from 0 to 1 */
    const double *A;      /* (m, n, n), and */
    const double *G;      /* (m, c, n) the continuous matrices, G transposed */
    const int64_t *slot;  /* (N_SLOTS,) index in `first` of a slot's first place */
    const int64_t *first; /* the laws at a place: entries first[place] to first[place + 1] - 1 */
    const Law *law;
    const double *link;            /* (links, N_LINK) */
    const int64_t *link_ends;      /* (links, 2) */
    const int64_t *friction_ends;  /* (frictions, 2) */
    const double *circuit, *screw; /* (N_CIRCUIT,), (N_SCREW,) */
    const double *sensor;          /* (sensors, N_SENSOR) */
    const int64_t *sensor_whole;   /* a sensor's delay: whole samples, */
    const int64_t *sensor_tick;    /* the tick of a sample at or after which it looks (0: at its end), */
    const double *sensor_part;     /* and how much of a tick after it */
    const double *sensor_play;     /* half the gap between what it senses and what turns it */
} Plant;

/* What changes while a plant is simulated, and room to work in. */
typedef struct {
    double *x;        /* (n,) */
    double *gear;     /* (2,) theta_d while the gear is out of contact or its motion imposed, and then its rate */
    int64_t *mode;    /* (1 + frictions,) the gear, then -1/0/1: a friction contact slips back, sticks, slips */
    double *commands; /* (delay_whole + 2,) the last commands, newest first */
    double *seen;     /* (depth, sensors) what the sensors have looked at, newest first */
    double *caught;   /* (sensors,) what those that look within a sample saw in the last one */
    double *played;   /* (sensors,) where those behind a gap stand */
    double *xn, *xp;  /* (n,) the step's end, and as it was predicted */
    double *w0, *w1;  /* (c,) channels at the step's start and end */
    int64_t *lean;    /* (1,) the side on which the motor leans on a load that it cannot move, or 0 */
    double *reaction; /* (frictions,) the force that keeps a sticking contact at rest */
    double *load;     /* (entries,) what the place of a dry friction carries */
    double *now;      /* (2,) time, s, and voltage in force, for what is measured of forces */
} State;

/* Gains and whitening of a pass, and the readings that it is corrected by; mode 1 while the gear is in contact. The
 * state becomes known in the first `opening` samples.
 * K (2, g, n, m), W (2, g, m, m), which (N,) : those of each sample. Y (N, m), NaN where one is missing. chan (m,) :
 * their sensors. */
typedef struct {
    int64_t samples, readings, gains, opening;
    const double *K, *W, *Y;
    const int64_t *which, *chan;
} Correction;
