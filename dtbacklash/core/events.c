/* Events within a sample: the gear closes or opens, friction contacts come to rest, turn round or break loose. */
#include "core.h"

/* a contact is located well enough when the gear would move no farther than this by what is left, rad (relative to an
 * angle above 1 rad) */
static const double NEAR_RAD = 1e-12;

typedef enum { NO_EVENT, GEAR_CLOSES, GEAR_OPENS, FRICTION_TURNS, LEANING_ENDS } Event;

/* Acceleration of a contact's slip under the channels w; *mobility : what one newton on it adds. */
static double slip_acceleration(const Plant *P, const double *x, const double *w, int64_t c, int contact,
                                double *mobility)
{
    double acceleration = 0.0;

    *mobility = 0.0;
    for (int k = 1; k >= 0; k--) {
        int64_t end = P->friction_ends[2 * c + k];
        double sign = k ? 1.0 : -1.0;
        if (end >= 0) {
            acceleration += sign * body_acceleration(P, x, w, contact, end);
            *mobility += effect_of(P, contact, CH_F + end)[P->position + P->bodies + end];
        } else if (reaches_rotor(P, contact, end)) {
            acceleration += sign * P->screw[S_LEAD] * body_acceleration(P, x, w, contact, P->rotor);
        }
    }
    return acceleration;
}

/* Whether a contact that slips has turned round, or one that sticks cannot be held any longer. */
static Event friction_event(const Plant *P, State *S, int64_t mode, double theta_d, double gap_rate)
{
    int contact = mode != FREE;
    Event found = NO_EVENT;

    for (int64_t c = 0; c < P->frictions; c++)
        if (S->mode[1 + c] == 0) {
            add_effort(P, S->w1, contact, P->friction_ends[2 * c + 1], S->reaction[c]);
            add_effort(P, S->w1, contact, P->friction_ends[2 * c], -S->reaction[c]);
        }
    for (int64_t c = 0; c < P->frictions; c++) {
        double direction = (double)S->mode[1 + c];
        if (direction == 0.0) {
            if (fabs(S->reaction[c]) <= held_level(P, S, c, S->reaction[c])) {
                /* the step's mean is not what is needed at its end: correct it by the acceleration that it leaves */
                double mobility, acceleration = slip_acceleration(P, S->xn, S->w1, c, contact, &mobility);
                S->reaction[c] -= acceleration / mobility;
            }
            if (fabs(S->reaction[c]) > held_level(P, S, c, S->reaction[c]))
                found = FRICTION_TURNS;
        } else if (direction * slip_rate(P, S, S->xn, c, theta_d, gap_rate) < 0.0) {
            found = FRICTION_TURNS;
        }
    }
    return found;
}

/* Whether the motor that leans on its load lets go (-1) or overcomes it (+1) at state x; 0: neither. */
static int leaning_ends(const Plant *P, State *S, const double *x)
{
    double lean = (double)S->lean[0], base = P->screw[S_LEAD] * position_of(P, x, P->rotor);

    if (lean * body_acceleration(P, x, S->w1, 0, P->rotor) < 0.0)
        return -1;
    S->w1[CH_D] -= base;
    double loaded = body_acceleration(P, x, S->w1, 1, P->rotor);
    S->w1[CH_D] += base;
    return lean * loaded > 0.0;
}

/* The first kind of event that the step to S.xn has passed. gap : the half-gap at its end, rad. */
static Event find_event(const Plant *P, State *S, double gap, double gap_rate)
{
    int64_t mode = S->mode[0];
    double theta_d = S->gear[0];

    if (P->rotor >= 0 && mode != RIGID) {
        if (mode == FREE && S->lean[0] != 0) {
            if (leaning_ends(P, S, S->xn) != 0)
                return LEANING_ENDS;
        } else if (mode == FREE) {
            if (fabs(position_of(P, S->xn, P->rotor) - theta_d) > gap)
                return GEAR_CLOSES;
        } else if ((double)mode * velocity_of(P, S->xn, P->rotor) < gap_rate) {
            return GEAR_OPENS;
        }
    }
    return P->frictions > 0 ? friction_event(P, S, mode, theta_d, gap_rate) : NO_EVENT;
}

/* Whether the event of the gear lies so near to the end of the step of h seconds that nothing is lost. */
static int is_located(const Plant *P, const State *S, Event event, double gap, double gap_rate, double h)
{
    double theta_m, past;

    if (event == FRICTION_TURNS || event == LEANING_ENDS)
        return 0;
    theta_m = position_of(P, S->xn, P->rotor);
    if (event == GEAR_CLOSES)
        past = fabs(theta_m - S->gear[0]) - gap;
    else
        past = (gap_rate - (double)S->mode[0] * velocity_of(P, S->xn, P->rotor)) * h;
    return past <= NEAR_RAD * dmax(1.0, fabs(theta_m));
}

/* The base has jumped to the motor's speed: friction contacts with an end on it slip from now on. */
static void jerk_base_contacts(const Plant *P, State *S, double gap_rate)
{
    for (int64_t c = 0; c < P->frictions; c++)
        if (side_of_base(P->friction_ends + 2 * c) != 0)
            S->mode[1 + c] = sign_of(slip_rate(P, S, S->x, c, S->gear[0], gap_rate));
}

/* The teeth meet without rebound: the motor shares its momentum with what the screw carries. */
static void close_gear(const Plant *P, State *S, double beyond, double gap_rate)
{
    double *speed = S->x + P->position + P->bodies + P->rotor;
    double carried = P->screw[S_SHARE] * (P->screw[S_LEAD] * P->screw[S_LEAD]) * P->screw[S_BASE_MASS];
    double inertia = P->screw[S_INERTIA];

    S->mode[0] = beyond > 0.0 ? PLUS : MINUS;
    if (carried != 0.0)
        *speed = (inertia * *speed + carried * (double)S->mode[0] * gap_rate) / (inertia + carried);
    jerk_base_contacts(P, S, gap_rate);
}

/* The gear lets go; a motor that its load cannot let go of leans on it. */
static void open_gear(const Plant *P, State *S, double theta_m, double gap, double gap_rate)
{
    int64_t mode = S->mode[0];

    S->gear[0] = theta_m - (double)mode * gap;
    S->mode[0] = FREE;
    if (P->screw[S_SHARE] == 0.0)
        return;
    S->w1[CH_D] += P->screw[S_LEAD] * theta_m; /* the base's place for the free gear's matrices */
    if ((double)mode * body_acceleration(P, S->x, S->w1, 0, P->rotor) > 0.0) {
        S->lean[0] = mode;
        S->x[P->position + P->bodies + P->rotor] = (double)mode * gap_rate;
    }
}

/* Let the gear close or open at the present state. */
static void switch_gear(const Plant *P, State *S, double gap, double gap_rate)
{
    int64_t mode = S->mode[0];

    if (P->rotor < 0 || mode == RIGID)
        return;
    double theta_m = position_of(P, S->x, P->rotor);
    if (S->lean[0] != 0) {
        int ends = leaning_ends(P, S, S->x);
        if (ends != 0) {
            S->mode[0] = ends > 0 ? S->lean[0] : FREE;
            S->lean[0] = 0;
        }
    } else if (mode == FREE) {
        double z = theta_m - S->gear[0];
        if (fabs(z) > gap)
            close_gear(P, S, z, gap_rate);
    } else if ((double)mode * velocity_of(P, S->x, P->rotor) < gap_rate) {
        open_gear(P, S, theta_m, gap, gap_rate);
    }
}

/* Take out the rest of a contact's slip by an impulse (N s) between its ends. */
static void stop_contact(const Plant *P, State *S, int64_t c, int contact, double impulse)
{
    int64_t first = P->position + P->bodies, a = P->friction_ends[2 * c], b = P->friction_ends[2 * c + 1];

    if (b >= 0)
        S->x[first + b] -= impulse * effect_of(P, contact, CH_F + b)[first + b];
    if (a >= 0)
        S->x[first + a] += impulse * effect_of(P, contact, CH_F + a)[first + a];
}

/* Let a contact that has turned round at `rate` come to rest, or slip the other way. */
static void turn_contact(const Plant *P, State *S, int64_t c, double rate, double t, double theta_d, double voltage)
{
    int contact = S->mode[0] != FREE;
    double mobility, *w = S->w0;

    S->mode[1 + c] = 0;
    set_zero(w, P->channels);
    w[CH_V] = voltage;
    w[CH_D] = P->screw[S_LEAD] * (theta_d - (contact && P->rotor >= 0 ? position_of(P, S->x, P->rotor) : 0.0));
    add_forces(P, S, S->x, w, contact, t, (Motion){theta_d, 0.0});
    double acceleration = slip_acceleration(P, S->x, w, c, contact, &mobility);
    int turns = fabs(acceleration) > mobility * held_level(P, S, c, -acceleration);
    if (turns && P->imposed && side_of_base(P->friction_ends + 2 * c) != 0) {
        S->mode[1 + c] = rate > 0.0 ? 1 : -1; /* it passes through rest: what it has left of speed is its own */
        return;
    }
    stop_contact(P, S, c, contact, rate / mobility);
    if (turns)
        S->mode[1 + c] = acceleration > 0.0 ? 1 : -1;
}

/* Let friction contacts come to rest, turn round or break loose at the present state. */
static void switch_friction(const Plant *P, State *S, double t, double gap, double gap_rate, double voltage)
{
    if (P->frictions == 0)
        return;
    double theta_d = P->imposed ? S->gear[0] : screw_angle(P, S, gap);
    for (int64_t c = 0; c < P->frictions; c++) {
        if (S->mode[1 + c] == 0) {
            if (fabs(S->reaction[c]) > held_level(P, S, c, S->reaction[c]))
                S->mode[1 + c] = S->reaction[c] > 0.0 ? -1 : 1;
            continue;
        }
        double rate = slip_rate(P, S, S->x, c, theta_d, gap_rate);
        if ((double)S->mode[1 + c] * rate < 0.0)
            turn_contact(P, S, c, rate, t, theta_d, voltage);
    }
}

/* Contacts with the imposed base whose slip has turned round by a jump of the base's speed slip the other way.
 *
 * A measured angle moves in jerks, of its noise at least. Friction cannot follow one that it could not stop within the
 * step of h seconds: the impulse that would is no force of its. */
static void turn_base_contacts(const Plant *P, State *S, double h, double theta_d, double gap_rate)
{
    int contact = S->mode[0] != FREE;

    for (int64_t c = 0; c < P->frictions; c++) {
        const int64_t *ends = P->friction_ends + 2 * c;
        if (S->mode[1 + c] == 0 || side_of_base(ends) == 0)
            continue;
        double rate = slip_rate(P, S, S->x, c, theta_d, gap_rate);
        double mobility = relative_response(P, effect_of(P, contact, 0), P->position + P->bodies, ends, 1.0);
        if ((double)S->mode[1 + c] * rate < 0.0 && fabs(rate) > mobility * h * held_level(P, S, c, -rate))
            S->mode[1 + c] = rate > 0.0 ? 1 : -1;
    }
}

/* Whether the imposed base has torn contacts loose in the step just tried; they slip from its start then. */
static int tear_loose(const Plant *P, State *S)
{
    int torn = 0;

    for (int64_t c = 0; c < P->frictions; c++) {
        if (S->mode[1 + c] != 0 || side_of_base(P->friction_ends + 2 * c) == 0)
            continue;
        if (fabs(S->reaction[c]) > held_level(P, S, c, S->reaction[c])) {
            S->mode[1 + c] = S->reaction[c] > 0.0 ? -1 : 1;
            torn = 1;
        }
    }
    return torn;
}

/* At a sample's start: no gap means rigid, and a gap that opens faster than the motor follows frees the gear. */
static void settle_gear(const Plant *P, State *S, double gap0, double gap1, double gap_rate)
{
    int64_t mode = S->mode[0];

    if (gap0 == 0.0 && gap1 == 0.0) {
        S->mode[0] = RIGID;
    } else if (mode == RIGID) {
        S->gear[0] = position_of(P, S->x, P->rotor);
        S->mode[0] = FREE;
    } else if (mode != FREE && (double)mode * velocity_of(P, S->x, P->rotor) < gap_rate) {
        S->gear[0] = position_of(P, S->x, P->rotor) - (double)mode * gap0;
        S->mode[0] = FREE;
    }
}
