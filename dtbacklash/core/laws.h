/* What a law may ask for in each slot, SI, and how a formula of a user is evaluated.
 *
 * A struct has the name of its slot in physics/effects/slots.py, and the slot's states in their order. A law is
 * `double name(const Slot *at, const double *p)`; p : the parameters of its effect, in the order of the declaration.
 */
typedef struct { double position, velocity, time, command; } BodyEffort;
typedef struct { double memory, position, velocity, time; } BodyMemory;
typedef struct { double slip_speed, direction, load; } Contact;
typedef struct { double stretch, stretch_rate, time, spring_stiffness, spring_damping; } SpringForce;
typedef struct { double stretch; } SpringPlay;
typedef struct { double memory, change; } SpringMemory;
typedef struct { double command; } Command;
typedef struct { double memory, current, resistance; } WindingMemory;
typedef struct { double current, position, torque_constant; } MotorTorque;
typedef struct { double angle; } Lead;
typedef struct { double reading; } Reading;

/* operations of a formula: the first three put a number on the stack, the others replace the last one or two on it */
enum {
    OP_CONSTANT, OP_STATE, OP_PARAMETER,
    OP_NEGATIVE, OP_SQUARE, OP_ABS, OP_SIGN, OP_SIN, OP_COS, OP_TAN, OP_ATAN, OP_EXP, OP_LOG, OP_SQRT, OP_TANH,
    OP_ADD, OP_SUBTRACT, OP_MULTIPLY, OP_DIVIDE, OP_POWER, OP_MIN, OP_MAX
};

/* numbers on a formula's stack, at most */
enum { STACK = 64 };

/* A formula as a program of a stack machine: operations, and of the first three which number they put there. */
typedef struct {
    int64_t length;
    const int64_t *operation, *number; /* (length,) */
    const double *constant;
} Formula;

/* A law at a place: its one or two functions, compiled or as formulas, its parameters, and what it acts on: a body, the
 * index of its memory in x, or what a friction carries. */
typedef struct {
    void (*call[2])(void);
    const Formula *formula[2];
    const double *p;
    int64_t at;
} Law;
