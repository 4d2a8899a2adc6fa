/* What remembers: memories after a step, and the force of a spring that goes with its own at the step's end.
 *
 * A memory follows the stretch in closed form, however small its reach is beside a step's motion. A spring that yields
 * within micrometres is stiff until it does: the force at the end of a step is solved for together with the stretch to
 * which it leads, which no step is too long for. The memory of a body's law follows its rate. */
#include "core.h"

/* the force is solved for to this share of its change */
static const double SOLVED = 1e-8;
enum { MOST_ROUNDS = 60 };

/* Stretch of link j at state x and a screw's angle, m or rad. */
static double stretch_at(const Plant *P, const double *x, int64_t j, double angle)
{
    Motion base = {P->has_base ? base_motion(P, angle, 0.0).at : 0.0, 0.0};
    return stretch_of(P, x, j, base).at;
}

/* A body's memory after a step of h seconds from q0, v0 to q1, v1.
 *
 * Exponential time differencing with the rate's slope by the memory in the middle, and a rate that goes linearly from
 * what it is at the start to what it is at the end (Cox & Matthews, J. Comput. Phys. 176 (2002) 430): exact where the
 * rate is linear in the memory and in such a motion, and stable however fast the memory falls. */
static double advance_memory(const Law *law, double z, Motion from, Motion to, double t, double h)
{
    double first = memory_rate(law, (BodyMemory){z, from.at, from.rate, t});
    double last = memory_rate(law, (BodyMemory){z, to.at, to.rate, t + h});
    double near = 1e-4 * (fabs(z) + h * dmax(fabs(first), fabs(last)));

    if (near == 0.0)
        return z;
    double q = 0.5 * (from.at + to.at), v = 0.5 * (from.rate + to.rate), middle = t + 0.5 * h;
    double above = memory_rate(law, (BodyMemory){z + near, q, v, middle});
    double below = memory_rate(law, (BodyMemory){z - near, q, v, middle});
    double a = dmin(0.5 * h * (above - below) / near, 30.0);
    if (fabs(a) < 1e-4)
        return z + h * (first * (0.5 + a / 3.0) + last * (0.5 + a / 6.0));
    double held = expm1(a) / a;
    return z + h * (held * first + (held - 1.0) / a * (last - first));
}

/* Set the memories of the bodies' laws at the step's end. */
static void update_body_memories(const Plant *P, State *S, double t, double h)
{
    for (int64_t i = 0; i < P->bodies; i++) {
        int64_t place = place_of(P, BODY_MEMORY, i);
        Motion from = {position_of(P, S->x, i), velocity_of(P, S->x, i)};
        Motion to = {position_of(P, S->xn, i), velocity_of(P, S->xn, i)};
        for (const Law *law = first_law(P, place); law < end_of_laws(P, place); law++)
            S->xp[law->at] = S->xn[law->at] = advance_memory(law, S->x[law->at], from, to, t, h);
    }
}

/* Set the memories at the step's end, in S.xn and S.xp, by the motion from S.x to S.xn.
 * angle, angle_end : theta_d at the step's start and end, rad. t : time at its start, s. h : its length, s. */
static void update_memories(const Plant *P, State *S, double angle, double angle_end, double t, double h)
{
    if (acts(P, BODY_MEMORY))
        update_body_memories(P, S, t, h);
    for (int64_t j = 0; P->remembers && j < P->links; j++) {
        int64_t place = place_of(P, LINK, PER_LINK * j + MEMORIES);
        if (first_law(P, place) == end_of_laws(P, place))
            continue;
        double s = stretch_at(P, S->x, j, angle), change = stretch_at(P, S->xn, j, angle_end) - s;
        for (const Law *law = first_law(P, place); law < end_of_laws(P, place); law++)
            S->xp[law->at] = S->xn[law->at] = memory_after(law, (SpringMemory){S->x[law->at], change});
    }
}

/* How far a memory's force lies above `force` after a change of the stretch, N. */
static double excess_force(const Law *law, double z, double change, double force)
{
    return memory_force(law, (SpringMemory){memory_after(law, (SpringMemory){z, change}), change}) - force;
}

/* By how much a memory's force exceeds what was expected, with the stretch that it leads to, N.
 *
 * The more it pulls the ends together the less the link is stretched, so that what is left falls with it: a root in a
 * bracket, by secants, and the Illinois rule where one of its ends stays.
 * give : how much less the link is stretched by a unit of it. expected : the memory that was expected. */
static double solve_memory_force(const Law *law, double z, double change, double give, double expected)
{
    double held = memory_force(law, (SpringMemory){expected, change});
    double low = 0.0, high = excess_force(law, z, change, held), left_low = high, enough = SOLVED * fabs(high);
    int stayed = 0;

    if (high == 0.0 || give <= 0.0)
        return high;
    double left_high = excess_force(law, z, change - give * high, held + high);
    for (int round = 0; round < MOST_ROUNDS; round++) {
        if (fabs(left_high) <= enough || left_high == left_low)
            break;
        double at = high - left_high * (high - low) / (left_high - left_low);
        double left = excess_force(law, z, change - give * at, held + at);
        if ((left > 0.0) != (left_high > 0.0)) {
            low = high;
            left_low = left_high;
            stayed = 0;
        } else {
            left_low *= stayed ? 0.5 : 1.0;
            stayed = 1;
        }
        high = at;
        left_high = left;
    }
    return high;
}

/* Solve for the forces of the springs that remember at the step's end, each with the stretch that it leads to.
 * S.xn holds the step's end under the forces that the predictor expected there, and the memories with them. */
static void solve_memory_forces(const Plant *P, State *S, int level, int contact, double angle, double angle_end)
{
    const double *R = rising_response(P, contact, level);

    for (int64_t j = 0; P->remembers && j < P->links; j++) {
        int64_t place = place_of(P, LINK, PER_LINK * j + MEMORIES);
        if (first_law(P, place) == end_of_laws(P, place))
            continue;
        const int64_t *ends = P->link_ends + 2 * j;
        double lever = P->link[j * N_LINK + L_LEVER], s = stretch_at(P, S->x, j, angle);
        double give = relative_response(P, R, P->position, ends, lever);
        for (const Law *law = first_law(P, place); law < end_of_laws(P, place); law++) {
            double change = stretch_at(P, S->xn, j, angle_end) - s;
            double more = solve_memory_force(law, S->x[law->at], change, give, S->xn[law->at]);
            add_response(P, S, R, contact, ends, lever, -more);
            add_effort(P, S->w1, contact, ends[1], -more);
            add_effort(P, S->w1, contact, ends[0], lever * more);
        }
    }
}
