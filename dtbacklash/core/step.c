/* One step of the plant: exact linear propagation, forces by a predictor and a corrector.
 *
 * Second order in the step for forces beside the linear plant; exact for the linear plant, whether the gear is in
 * contact or not. */
#include "core.h"

/* theta_d, rad, at the present state with half-gap `gap`. */
static double screw_angle(const Plant *P, const State *S, double gap)
{
    int64_t mode = S->mode[0];

    if (mode == FREE || P->rotor < 0)
        return S->gear[0];
    double theta_m = position_of(P, S->x, P->rotor);
    return mode == RIGID ? theta_m : theta_m - (double)mode * gap;
}

/* Rate of theta_d, rad/s. */
static double rate_of_screw(const Plant *P, const double *x, int64_t mode, double gap_rate)
{
    if (mode == FREE || P->rotor < 0)
        return 0.0;
    double omega = velocity_of(P, x, P->rotor);
    return mode == RIGID ? omega : omega - (double)mode * gap_rate;
}

/* Rate of theta_d, rad/s, at state x, whether it is imposed or simulated. */
static double drive_rate(const Plant *P, const State *S, const double *x, double gap_rate)
{
    return P->imposed ? S->gear[1] : rate_of_screw(P, x, S->mode[0], gap_rate);
}

/* states up to which the propagation is unrolled */
enum { MOST_UNROLLED = 8 };

/* sum (n,) += E x for the transposed transition matrix E (n, n). */
UNROLLED void add_transition(int64_t n, const double *restrict E, const double *restrict x, double *restrict sum)
{
    for (int64_t j = 0; j < n; j++)
        for (int64_t i = 0; i < n; i++)
            sum[i] += E[j * n + i] * x[j];
}

/* sum (n,) += the rows of P1 (channels, n), each times its w: most channels are 0. */
UNROLLED void add_held(int64_t n, int64_t channels, const double *restrict P1, const double *restrict w,
                       double *restrict sum)
{
    for (int64_t j = 0; j < channels; j++)
        if (w[j] != 0.0)
            for (int64_t i = 0; i < n; i++)
                sum[i] += P1[j * n + i] * w[j];
}

/* sum (n,) += the rows of P2 (channels, n), each times the rise of its w from w0 to w1. */
UNROLLED void add_rise(int64_t n, int64_t channels, const double *restrict P2, const double *restrict w0,
                       const double *restrict w1, double *restrict sum)
{
    for (int64_t j = 0; j < channels; j++) {
        double rise = w1[j] - w0[j];
        if (rise != 0.0)
            for (int64_t i = 0; i < n; i++)
                sum[i] += P2[j * n + i] * rise;
    }
}

/* The step's end under held inputs, of n <= MOST_UNROLLED states: a constant, so that sums are registers. */
UNROLLED void propagate_n(int64_t n, const State *S, const double *E, const double *P1, int64_t channels)
{
    double sum[MOST_UNROLLED] = {0.0};

    add_transition(n, E, S->x, sum);
    add_held(n, channels, P1, S->w0, sum);
    for (int64_t i = 0; i < n; i++)
        S->xn[i] = S->xp[i] = sum[i];
}

/* What the rise of the inputs adds to it, of n <= MOST_UNROLLED states. */
UNROLLED void ramp_n(int64_t n, const State *S, const double *P2, int64_t channels)
{
    double sum[MOST_UNROLLED];

    for (int64_t i = 0; i < n; i++)
        sum[i] = S->xp[i];
    add_rise(n, channels, P2, S->w0, S->w1, sum);
    for (int64_t i = 0; i < n; i++)
        S->xn[i] = sum[i];
}

/* S.xn = S.xp = E x + P1 w0 over the first `channels`: the inputs of the step's start, held. */
static void propagate(const Plant *P, State *S, int level, int contact, int64_t channels)
{
    const double *E = transition(P, contact, level), *P1 = held_response(P, contact, level);

    switch (P->n) {
    case 2: propagate_n(2, S, E, P1, channels); break;
    case 3: propagate_n(3, S, E, P1, channels); break;
    case 4: propagate_n(4, S, E, P1, channels); break;
    case 5: propagate_n(5, S, E, P1, channels); break;
    case 6: propagate_n(6, S, E, P1, channels); break;
    case 7: propagate_n(7, S, E, P1, channels); break;
    case 8: propagate_n(8, S, E, P1, channels); break;
    default:
        set_zero(S->xn, P->n);
        add_transition(P->n, E, S->x, S->xn);
        add_held(P->n, channels, P1, S->w0, S->xn);
        copy(S->xn, S->xp, P->n);
    }
}

/* S.xn = S.xp + P2 (w1 - w0): the inputs rise linearly to those of the step's end. */
static void ramp(const Plant *P, State *S, int level, int contact, int64_t channels)
{
    const double *P2 = rising_response(P, contact, level);

    switch (P->n) {
    case 2: ramp_n(2, S, P2, channels); break;
    case 3: ramp_n(3, S, P2, channels); break;
    case 4: ramp_n(4, S, P2, channels); break;
    case 5: ramp_n(5, S, P2, channels); break;
    case 6: ramp_n(6, S, P2, channels); break;
    case 7: ramp_n(7, S, P2, channels); break;
    case 8: ramp_n(8, S, P2, channels); break;
    default: copy(S->xp, S->xn, P->n); add_rise(P->n, channels, P2, S->w0, S->w1, S->xn);
    }
}

/* Velocity at which friction contact c slips at state x, m/s or rad/s. */
static double slip_rate(const Plant *P, const State *S, const double *x, int64_t c, double theta_d, double gap_rate)
{
    double base_rate = 0.0;

    if (P->has_base && side_of_base(P->friction_ends + 2 * c) != 0)
        base_rate = base_motion(P, theta_d, drive_rate(P, S, x, gap_rate)).rate;
    return slip_of(P, x, c, base_rate);
}

/* A body that sticks to the ground stays to the last bit, so that it cannot creep into or out of a contact. */
static void pin_sticking(const Plant *P, State *S)
{
    for (int64_t c = 0; c < P->frictions; c++) {
        int64_t a = P->friction_ends[2 * c], b = P->friction_ends[2 * c + 1];
        if (S->mode[1 + c] == 0 && a == GROUND && b >= 0) {
            S->xn[P->position + b] = S->x[P->position + b];
            S->xn[P->position + P->bodies + b] = 0.0;
        }
    }
}

/* Find the forces that bring every sticking contact to rest at the end of the step (Gauss-Seidel). */
static void hold_contacts(const Plant *P, State *S, int level, int contact, double theta_d, double gap_rate)
{
    const double *R = held_response(P, contact, level);
    int sticking = 0;

    for (int64_t c = 0; c < P->frictions; c++) {
        S->reaction[c] = 0.0;
        sticking += S->mode[1 + c] == 0;
    }
    if (sticking == 0)
        return;
    for (int round = 0; round < (sticking == 1 ? 1 : 60); round++) {
        double worst = 0.0;
        for (int64_t c = 0; c < P->frictions; c++) {
            if (S->mode[1 + c] != 0)
                continue;
            const int64_t *ends = P->friction_ends + 2 * c;
            double rate = slip_rate(P, S, S->xn, c, theta_d, gap_rate);
            double change = -rate / relative_response(P, R, P->position + P->bodies, ends, 1.0);
            S->reaction[c] += change;
            add_response(P, S, R, contact, ends, 1.0, change);
            worst = dmax(worst, fabs(change) - 1e-12 * fabs(S->reaction[c]));
        }
        if (worst <= 0.0)
            break;
    }
    pin_sticking(P, S);
}

/* What the base feels of the screw beyond the motor's angle, at a step's start and end. held : angle of a free screw.
 */
static void set_drive_channels(const Plant *P, State *S, double h, double gap, double gap_rate, double held)
{
    double lead = P->screw[S_LEAD], mode = (double)S->mode[0], *w0 = S->w0, *w1 = S->w1;

    if (S->mode[0] == FREE) {
        w0[CH_D] = lead * held;
        w1[CH_D] = w0[CH_D] + lead * S->gear[1] * h;
        w0[CH_DD] = lead * S->gear[1];
    } else if (S->mode[0] == RIGID) {
        w0[CH_D] = 0.0;
        w1[CH_D] = 0.0;
        w0[CH_DD] = 0.0;
    } else {
        w0[CH_D] = -lead * mode * gap;
        w1[CH_D] = -lead * mode * (gap + gap_rate * h);
        w0[CH_DD] = -lead * mode * gap_rate;
    }
    w1[CH_DD] = w0[CH_DD];
}

/* A step under voltage and screw alone. */
static void linear_step(const Plant *P, State *S, int level, int contact)
{
    propagate(P, S, level, contact, P->has_base ? CH_F : CH_D);
    if (P->has_base)
        ramp(P, S, level, contact, CH_F);
}

/* Predictor with the forces of the start, corrector with their mean slope, friction at rest solved in both.
 * What springs remember follows from the stretch of each; their force at the end is solved for in the corrector. */
static void forced_step(const Plant *P, State *S, int level, double h, double t, int contact, double gap,
                        double gap_rate, double given)
{
    int64_t mode = S->mode[0];
    double start = P->imposed ? given : screw_angle(P, S, gap);
    Motion drive = {start, drive_rate(P, S, S->x, gap_rate)};

    add_forces(P, S, S->x, S->w0, contact, t, drive);
    propagate(P, S, level, contact, P->channels);
    if (P->imposed)
        drive.at = given + S->gear[1] * h;
    hold_contacts(P, S, level, contact, drive.at, gap_rate);
    if (!P->imposed && mode != FREE && P->rotor >= 0) {
        double behind = mode == RIGID ? 0.0 : (double)mode * (gap + gap_rate * h);
        drive.at = position_of(P, S->xn, P->rotor) - behind;
        drive.rate = rate_of_screw(P, S->xn, mode, gap_rate);
    }
    update_memories(P, S, start, drive.at, t, h);
    add_forces(P, S, S->xn, S->w1, contact, t + h, drive);
    ramp(P, S, level, contact, P->channels);
    solve_memory_forces(P, S, level, contact, start, drive.at);
    hold_contacts(P, S, level, contact, drive.at, gap_rate);
    update_memories(P, S, start, drive.at, t, h);
}

/* Keep the motor on the tooth on which it leans, which stands still or moves away as the gap grows. */
static void hold_lean(const Plant *P, State *S, int level, double h, double gap_rate)
{
    int64_t speed = P->position + P->bodies + P->rotor;
    const double *R = held_response(P, 0, level) + (CH_F + P->rotor) * P->n;
    double tooth_rate = (double)S->lean[0] * gap_rate, force = (tooth_rate - S->xn[speed]) / R[speed];

    for (int64_t i = 0; i < P->n; i++)
        S->xn[i] += R[i] * force;
    S->xn[P->position + P->rotor] = S->x[P->position + P->rotor] + tooth_rate * h;
    S->xn[speed] = tooth_rate;
}

/* Advance S.x into S.xn by a step of h seconds with the contacts as they are.
 * given : theta_d at the start where the motor's angle is imposed; its rate stands in S.gear[1]. */
static void try_step(const Plant *P, State *S, int level, double h, double t, double voltage, double gap,
                     double gap_rate, double given)
{
    int contact = S->mode[0] != FREE;

    if (P->forced) {
        set_zero(S->w0, P->channels);
        set_zero(S->w1, P->channels);
    }
    S->w0[CH_V] = voltage;
    S->w1[CH_V] = voltage;
    if (P->has_base)
        set_drive_channels(P, S, h, gap, gap_rate, P->imposed ? given : S->gear[0]);
    if (P->forced)
        forced_step(P, S, level, h, t, contact, gap, gap_rate, given);
    else
        linear_step(P, S, level, contact);
    if (S->lean[0] != 0)
        hold_lean(P, S, level, h, gap_rate);
}
