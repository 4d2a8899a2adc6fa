/* A simulator's model as the core steps it, and an FMU as such a model: see diagnosis/engine/external_simulator.py. */

/* columns of `sensors` of a model: what one shows, of which joint or output, and how late it is, s */
enum { M_SHOWS, M_PLACE, M_LATE, N_MODEL_SENSOR };
enum { SHOWS_POSITION, SHOWS_VELOCITY, SHOWS_ACCELERATION, SHOWS_EFFORT, SHOWS_OUTPUT };

/* A function of a simulator: of a model and its data. */
typedef void (*OfModel)(void *model, void *data);

/* A model with the parameters of a rig, what acts at each step, and what its sensors show. A state is the positions and
 * the speeds of the joints, the other states, and position and speed in each gap. */
typedef struct {
    OfModel step, forward, back; /* a step; what follows from a state, or NULL; to the first state and time */
    void *model, *data;
    void *far; /* the model whose step is `ratio` of those of `model`, and whose friction is without that of laws */
    int64_t degrees, joints, others, commands, sensors;
    double *q, *v, *acceleration, *push, *load; /* (degrees,) */
    double *friction;                           /* (degrees,) levels of dry friction, */
    const double *still;                        /* and the model's own */
    double *more, *ctrl, *clock;                /* (others,) states; (commands,); (1,) its time, s */
    const double *shown;                        /* (outputs,) */
    const int64_t *at;                          /* (joints,) which degree of freedom a joint is, */
    const int64_t *behind;                      /* and which is the gap behind it, or -1 */
    const double *U;                            /* (fine, commands) from the first reading on, which is at `begin`, s */
    int64_t fine, whole, ratio;                 /* fine steps in all, of a reading, of a far step */
    double begin, h;                            /* h : a fine step, s */
    int64_t efforts, levels, reads;             /* counts of laws; */
    const Law *effort, *level, *read;           /* of joints, of dry frictions of joints, of sensors */
    const double *sensor;                       /* (sensors, N_MODEL_SENSOR) */
} Model;

/* What an FMU says of its events: `fmi2EventInfo`; FMI 3.0 says each of these by itself. */
typedef struct {
    int32_t again, ends, nominals, moved, strikes;
    double next;
} EventInfo;

/* An FMU for Model Exchange. States are in our order: positions, speeds, others. */
typedef struct {
    void *instance;
    int (*set_time)(void *, double);
    int (*set_states)(void *, const double *, size_t);
    int (*get_rates)(void *, double *, size_t);
    int (*get_states)(void *, double *, size_t);
    int (*get_signs)(void *, double *, size_t);
    int (*begin_event)(void *);
    int (*end_event)(void *);
    void (*set_inputs)(void), (*get_outputs)(void), (*completed)(void), (*decide)(void); /* of FMI 2.0 or 3.0 */
    int64_t threes, follows, decisions; /* of FMI 3.0; whether events are followed; turns of one, at most */
    int64_t states, joints, commands, inputs, outputs, signs;
    const uint32_t *input_names, *output_names; /* references, */
    int64_t inputs_named, outputs_named;        /* fewer where an array has one for all of its numbers */
    const int64_t *order, *input, *force;  /* the FMU's place of a state; the input of a command, of a joint's force or -1 */
    double *clock;                         /* (1,) s */
    double step, next;                     /* s; when its clock strikes next */
    double *x, *rate;                      /* (states,) */
    double *theirs, *theirs_rate;          /* (states,) in the FMU's order */
    double *begun, *total, *rest;          /* (states,) of a step */
    double *given, *shown, *ctrl;          /* (inputs,) (outputs,) (commands,) */
    const double *still;                   /* (inputs,) where nothing acts */
    double *push, *friction, *held, *mark; /* (joints,) forces; levels; shares of them that hold, and held before */
    const double *damping;                 /* (joints,) */
    double *load;                          /* (joints,) efforts of the commands, */
    const double *share;                   /* (joints, commands) by a unit of each */
    double *pair;                          /* (joints, joints) what a joint's force adds to speeds */
    double *sign, *before;                 /* (signs,) event indicators now, and when events were last looked for */
} Fmu;
