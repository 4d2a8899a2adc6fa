/* The forces that act beside the linear plant: every law of the rig's effects, summed into channels. */
#include "core.h"

/* a screw whose friction grows faster than what drives it would jam: what it gives way is not less than this share */
static const double LEAST_YIELD = 0.05;

/* Position and velocity of something, m and m/s or rad and rad/s. */
typedef struct {
    double at, rate;
} Motion;

/* Position and velocity of body j. */
static inline double position_of(const Plant *P, const double *x, int64_t j) { return x[P->position + j]; }
static inline double velocity_of(const Plant *P, const double *x, int64_t j) { return x[P->position + P->bodies + j]; }

/* Position and velocity of the screw's base, m and m/s, with the error of its lead. */
static Motion base_motion(const Plant *P, double theta_d, double theta_d_rate)
{
    double lead = P->screw[S_LEAD];
    Motion base = {lead * theta_d, lead * theta_d_rate};
    int64_t place = place_of(P, LEAD, 0);

    for (const Law *law = first_law(P, place); law < end_of_laws(P, place); law++) {
        base.at += lead_error(law, (Lead){theta_d});
        base.rate += lead_slope(law, (Lead){theta_d}) * theta_d_rate;
    }
    return base;
}

/* Velocity of an end of a link or friction contact, m/s or rad/s. */
static inline double end_velocity(const Plant *P, const double *x, int64_t end, double base_rate)
{
    if (end >= 0)
        return velocity_of(P, x, end);
    return end == BASE ? base_rate : 0.0;
}

/* Position of an end of a link, m or rad. */
static inline double end_position(const Plant *P, const double *x, int64_t end, double base)
{
    if (end >= 0)
        return position_of(P, x, end);
    return end == BASE ? base : 0.0;
}

/* Whether what pushes an end pushes the motor: the base does, by the screw's reaction, while the gear is in contact. */
static inline int reaches_rotor(const Plant *P, int contact, int64_t end)
{
    return end == BASE && contact == 1 && P->rotor >= 0;
}

/* Add an effort to a body; on the base it reaches the rotor by the screw's reaction. */
static inline void add_effort(const Plant *P, double *w, int contact, int64_t end, double effort)
{
    if (end >= 0)
        w[CH_F + end] += effort;
    else if (reaches_rotor(P, contact, end))
        w[CH_F + P->rotor] += effort * P->screw[S_SHARE] * P->screw[S_LEAD];
}

/* S.xn += the response R to an effort on one end. */
static void add_end_response(const Plant *P, State *S, const double *R, int contact, int64_t end, double sign,
                             double effort)
{
    int64_t channel = end;
    double factor = sign;

    if (reaches_rotor(P, contact, end)) {
        channel = P->rotor;
        factor = sign * P->screw[S_SHARE] * P->screw[S_LEAD];
    }
    if (channel < 0 || factor == 0.0)
        return;
    for (int64_t i = 0; i < P->n; i++)
        S->xn[i] += R[(CH_F + channel) * P->n + i] * factor * effort;
}

/* S.xn += the response R to an effort that pushes end b and, by its lever, pushes end a back. */
static void add_response(const Plant *P, State *S, const double *R, int contact, const int64_t *ends, double lever,
                         double effort)
{
    add_end_response(P, S, R, contact, ends[1], 1.0, effort);
    add_end_response(P, S, R, contact, ends[0], -lever, effort);
}

/* What end b gains on end a under a unit effort that pushes them apart, by the response R (or G).
 * first : where in the state the bodies' positions (or velocities) begin. lever : of end a. */
static double relative_response(const Plant *P, const double *R, int64_t first, const int64_t *ends, double lever)
{
    int64_t a = ends[0], b = ends[1];
    double of_a = a >= 0 ? R[(CH_F + a) * P->n + first + a] : 0.0;
    double of_b = b >= 0 ? R[(CH_F + b) * P->n + first + b] : 0.0;
    double total = lever * lever * of_a + of_b;

    if (a >= 0 && b >= 0)
        total -= 2.0 * lever * R[(CH_F + a) * P->n + first + b];
    return total;
}

/* Stretch of link j and its rate, m and m/s (or rad and rad/s). */
static Motion stretch_of(const Plant *P, const double *x, int64_t j, Motion base)
{
    int64_t a = P->link_ends[2 * j], b = P->link_ends[2 * j + 1];
    double lever = P->link[j * N_LINK + L_LEVER];

    return (Motion){
        end_position(P, x, b, base.at) - lever * end_position(P, x, a, base.at),
        end_velocity(P, x, b, base.rate) - lever * end_velocity(P, x, a, base.rate),
    };
}

/* Force of link j beyond its spring and damper, N or N m. */
static double force_beside(const Plant *P, const double *x, int64_t j, Motion stretch, double t)
{
    double k = P->link[j * N_LINK + L_K], c = P->link[j * N_LINK + L_C], s = stretch.at, force = 0.0;
    int64_t place = place_of(P, LINK, PER_LINK * j);

    for (const Law *law = first_law(P, place + PLAYS); law < end_of_laws(P, place + PLAYS); law++) {
        double held = spring_stretch(law, (SpringPlay){s});
        force += k * (held - s);
        s = held;
    }
    for (const Law *law = first_law(P, place + FORCES); law < end_of_laws(P, place + FORCES); law++)
        force += spring_force(law, (SpringForce){s, stretch.rate, t, k, c});
    for (const Law *law = first_law(P, place + MEMORIES); law < end_of_laws(P, place + MEMORIES); law++)
        force += memory_force(law, (SpringMemory){x[law->at], 0.0});
    return force;
}

/* What link j pulls its ends together with, N or N m. */
static double link_force(const Plant *P, const double *x, int64_t j, Motion base, double t)
{
    const double *link = P->link + j * N_LINK;
    Motion stretch = stretch_of(P, x, j, base);

    return link[L_K] * stretch.at + link[L_C] * stretch.rate + force_beside(P, x, j, stretch, t);
}

/* Forces of the links beyond spring and damper. */
static void add_link_forces(const Plant *P, const double *x, double *w, int contact, double t, Motion base)
{
    for (int64_t j = 0; j < P->links; j++) {
        int64_t place = place_of(P, LINK, PER_LINK * j);
        if (P->first[place] == P->first[place + PER_LINK])
            continue;
        double force = force_beside(P, x, j, stretch_of(P, x, j, base), t);
        add_effort(P, w, contact, P->link_ends[2 * j + 1], -force);
        add_effort(P, w, contact, P->link_ends[2 * j], P->link[j * N_LINK + L_LEVER] * force);
    }
}

/* Efforts on single bodies. */
static void add_body_forces(const Plant *P, const double *x, double *w, double t)
{
    int64_t efforts = place_of(P, BODY_EFFORT, 0);

    for (const Law *law = first_law(P, efforts); law < first_law(P, efforts + P->bodies); law++)
        w[CH_F + law->at] +=
            body_effort(law, (BodyEffort){position_of(P, x, law->at), velocity_of(P, x, law->at), t, w[CH_V]});
    for (int64_t i = 0; acts(P, BODY_MEMORY) && i < P->bodies; i++) {
        int64_t place = place_of(P, BODY_MEMORY, i);
        for (const Law *law = first_law(P, place); law < end_of_laws(P, place); law++)
            w[CH_F + i] +=
                remembered_effort(law, (BodyMemory){x[law->at], position_of(P, x, i), velocity_of(P, x, i), t});
    }
}

/* What the motor makes beyond its constant times the current, N m or N. */
static double torque_beside(const Plant *P, const double *x)
{
    int64_t place = place_of(P, MOTOR_TORQUE, 0);
    double total = 0.0;

    for (const Law *law = first_law(P, place); law < end_of_laws(P, place); law++)
        total += motor_torque(law, (MotorTorque){x[P->current], position_of(P, x, P->driven), P->circuit[C_KT]});
    return total;
}

/* The channel that is the rate of a law's memory. */
static inline int64_t memory_channel(const Plant *P, const Law *law)
{
    return CH_F + P->bodies + law->at - (P->position + 2 * P->bodies);
}

/* What the motor makes beyond its constant, and the voltage that the state of its winding eats. */
static void add_circuit_forces(const Plant *P, const double *x, double *w)
{
    double i = x[P->current], R = P->circuit[C_R];
    int64_t place = place_of(P, WINDING, 0);

    w[CH_F + P->driven] += torque_beside(P, x);
    for (const Law *law = first_law(P, place); law < end_of_laws(P, place); law++) {
        w[CH_V] -= winding_voltage(law, (WindingMemory){x[law->at], i, R});
        /* the decay is linear and stands in A */
        w[memory_channel(P, law)] += winding_rate(law, (WindingMemory){0.0, i, R});
    }
}

/* Effort of a servo, and what it would be without limits, N or N m. The position loop asks for a speed, the loop below
 * it for an effort: position_gain (u - q) - speed_gain q'. */
static double servo_effort(const Plant *P, const double *x, const double *w, double *without)
{
    const double *of = P->circuit;
    double linear = of[C_POSITION] * (w[CH_V] - position_of(P, x, P->driven));
    double damped = of[C_SPEED] * velocity_of(P, x, P->driven);
    double effort = dmin(dmax(linear, -of[C_ASKED]), of[C_ASKED]) - damped;

    *without = linear - damped;
    return dmin(dmax(effort, -of[C_LARGEST]), of[C_LARGEST]);
}

/* What the limits of a servo take off the effort of its loop, which is linear and stands in A and G. */
static void add_servo_limits(const Plant *P, const double *x, double *w)
{
    double linear, effort = servo_effort(P, x, w, &linear);
    w[CH_F + P->driven] += effort - linear;
}

/* What the drive does to the body that it drives, N m or N. */
static double drive_effort(const Plant *P, const double *x, const double *w)
{
    double linear;

    if (P->current >= 0)
        return P->circuit[C_KT] * x[P->current] + torque_beside(P, x);
    if (P->circuit[C_POSITION] != 0.0)
        return servo_effort(P, x, w, &linear);
    return P->circuit[C_GAIN] * (P->lag >= 0 ? x[P->lag] : w[CH_V]);
}

/* What each dry friction carries but for that of the screw, N or N m, into S.load. */
static void find_loads(const Plant *P, State *S, const double *x, const double *w, double t, Motion base)
{
    int64_t place = place_of(P, FRICTION, 0);

    for (const Law *law = first_law(P, place); law < first_law(P, place + P->frictions); law++) {
        if (law->at == DRIVE)
            S->load[law - P->law] = drive_effort(P, x, w);
        else if (law->at >= 0)
            S->load[law - P->law] = P->link[law->at * N_LINK + L_LEVER] * link_force(P, x, law->at, base, t);
    }
}

/* Magnitude of dry friction at contact c at a slip speed >= 0 in a direction, N or N m. */
static double friction_level(const Plant *P, const State *S, int64_t c, double slip_speed, double direction)
{
    int64_t place = place_of(P, FRICTION, c);
    double level = 0.0;

    for (const Law *law = first_law(P, place); law < end_of_laws(P, place); law++)
        level += friction_of(law, (Contact){slip_speed, direction, S->load[law - P->law]});
    return level;
}

/* What contact c can hold against at rest: it would give way against the reaction that holds it, N or N m. */
static double held_level(const Plant *P, const State *S, int64_t c, double reaction)
{
    return friction_level(P, S, c, 0.0, reaction > 0.0 ? -1.0 : 1.0);
}

/* Velocity at which contact c slips when its base moves so, m/s or rad/s. */
static inline double slip_of(const Plant *P, const double *x, int64_t c, double base_rate)
{
    return end_velocity(P, x, P->friction_ends[2 * c + 1], base_rate)
           - end_velocity(P, x, P->friction_ends[2 * c], base_rate);
}

/* On which end of a link or contact the base is: 1 the first, -1 the second, 0 on none. */
static inline int side_of_base(const int64_t *ends) { return (ends[0] == BASE) - (ends[1] == BASE); }

/* Force of the structure on the screw's base, N. */
static double force_on_base(const Plant *P, const State *S, const double *x, double t, Motion base)
{
    double total = -P->screw[S_BASE_K] * base.at - P->screw[S_BASE_C] * base.rate;
    int64_t v = P->position + P->bodies;

    for (int64_t i = 0; i < P->bodies; i++) {
        double inverse = effect_of(P, 0, CH_F + i)[v + i];
        total +=
            (effect_of(P, 0, CH_D)[v + i] * position_of(P, x, i) + effect_of(P, 0, CH_DD)[v + i] * x[v + i]) / inverse;
    }
    for (int64_t j = 0; j < P->links; j++) {
        int sign = side_of_base(P->link_ends + 2 * j);
        if (sign != 0)
            total += sign * force_beside(P, x, j, stretch_of(P, x, j, base), t);
    }
    for (int64_t c = 0; c < P->frictions; c++) {
        int sign = side_of_base(P->friction_ends + 2 * c);
        if (sign == 0)
            continue;
        double direction = (double)S->mode[1 + c];
        double sliding = direction * friction_level(P, S, c, fabs(slip_of(P, x, c, base.rate)), direction);
        total += sign * (direction != 0.0 ? sliding : -S->reaction[c]);
    }
    return total;
}

/* Acceleration of a body under the channels w, m/s^2 or rad/s^2. */
static double body_acceleration(const Plant *P, const double *x, const double *w, int contact, int64_t body)
{
    int64_t i = P->position + P->bodies + body;
    const double *row = P->A + (contact * P->n + i) * P->n;
    double total = 0.0;

    for (int64_t j = 0; j < P->n; j++)
        total += row[j] * x[j];
    for (int64_t k = 0; k < P->channels; k++)
        total += effect_of(P, contact, k)[i] * w[k];
    return total;
}

/* Torque by which the screw pushes the base, before its friction, N m; `law` of contact c depends on it.
 *
 * The base's acceleration depends on this friction, size |load|, itself: with a mobility of the rotor g,
 * F = F0 - direction size lead^2 mass g |F|, where F0 is the force without it. */
static double screw_load(const Plant *P, State *S, const double *x, const double *w, int contact, int64_t c,
                         const Law *law, double slip_speed, double t, Motion base)
{
    double lead = P->screw[S_LEAD], direction = (double)S->mode[1 + c];

    if (contact == 0)
        return 0.0;
    double force = -force_on_base(P, S, x, t, base);
    if (direction != 0.0) {
        double mobility = effect_of(P, contact, CH_F + P->rotor)[P->position + P->bodies + P->rotor];
        S->load[law - P->law] = 0.0;
        double others = friction_level(P, S, c, slip_speed, direction), moved = P->screw[S_BASE_MASS] * lead;
        force += moved * (body_acceleration(P, x, w, contact, P->rotor) - direction * others * mobility);
        double by_itself = law->p[0] * lead * moved * mobility;
        force /= dmax(1.0 + direction * (force > 0.0 ? by_itself : -by_itself), LEAST_YIELD);
    }
    return lead * force;
}

/* Forces of the friction contacts that slip; those that stick are solved for in the step. */
static void add_slip_forces(const Plant *P, State *S, const double *x, double *w, int contact, double t, Motion base)
{
    for (int64_t c = 0; c < P->frictions; c++) {
        double direction = (double)S->mode[1 + c];
        if (direction == 0.0 && !P->loaded)
            continue;
        double speed = fabs(slip_of(P, x, c, base.rate));
        int64_t place = place_of(P, FRICTION, c);
        for (const Law *law = first_law(P, place); P->loaded && law < end_of_laws(P, place); law++)
            if (law->at == SCREW)
                S->load[law - P->law] = screw_load(P, S, x, w, contact, c, law, speed, t, base);
        if (direction != 0.0) {
            double level = friction_level(P, S, c, speed, direction);
            add_effort(P, w, contact, P->friction_ends[2 * c + 1], -direction * level);
            add_effort(P, w, contact, P->friction_ends[2 * c], direction * level);
        }
    }
}

/* Add to the channels w everything that acts beside the linear plant at state x and time t.
 * drive : theta_d and its rate, rad and rad/s. */
static void add_forces(const Plant *P, State *S, const double *x, double *w, int contact, double t, Motion drive)
{
    Motion base = {0.0, 0.0};

    if (P->has_base) {
        int64_t lead = place_of(P, LEAD, 0);
        base = base_motion(P, drive.at, drive.rate);
        if (first_law(P, lead) < end_of_laws(P, lead)) {
            w[CH_D] += base.at - P->screw[S_LEAD] * drive.at;
            w[CH_DD] += base.rate - P->screw[S_LEAD] * drive.rate;
        }
    }
    if (acts(P, LINK))
        add_link_forces(P, x, w, contact, t, base);
    add_body_forces(P, x, w, t);
    if (P->current >= 0)
        add_circuit_forces(P, x, w);
    if (P->limited)
        add_servo_limits(P, x, w);
    if (P->loaded)
        find_loads(P, S, x, w, t, base);
    add_slip_forces(P, S, x, w, contact, t, base);
}
