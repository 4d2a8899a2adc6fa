/* One sample of the plant: the amplifier, steps with located events, and what the sensors see at its end. */
#include "core.h"

/* a sample with more events than this (chatter) is finished without locating further ones: a contact at the edge of
 * slipping switches as often as it is looked at, which costs and changes nothing */
enum { MOST_EVENTS = 12 };

/* The half-gap at a sample's start, rad, and its rate, rad/s. */
typedef struct {
    double start, rate;
} Gap;

/* The motor's angle at all samples where it is imposed, rad, and the sample that begins. */
typedef struct {
    const double *at;
    int64_t samples, k;
} Imposed;

/* The voltage (or command of the actuator) that leaves the amplifier for the command u. */
static double amplify(const Plant *P, double u)
{
    int64_t place = place_of(P, COMMAND, 0);

    for (const Law *law = first_law(P, place); law < end_of_laws(P, place); law++)
        u = amplified_command(law, (Command){u});
    return u;
}

/* What is imposed at `share` of the way from a sample to the next, rad.
 *
 * Straight where a step is as long as a sample, so that its ramp is exact; else through its neighbours with a
 * continuous rate (Catmull & Rom, 1974): friction against what moves in jerks would let go at each of them. */
static double imposed_angle(const Plant *P, Imposed theta, double share)
{
    const double *at = theta.at + theta.k;
    double rise = at[1] - at[0];

    if (P->substeps == 1)
        return at[0] + share * rise;
    double first = theta.k > 0 ? 0.5 * (at[1] - at[-1]) : rise;
    double last = theta.k + 2 < theta.samples ? 0.5 * (at[2] - at[0]) : rise;
    double bend = (first - rise) * (1.0 - share) - (last - rise) * share;
    return at[0] + share * (rise + (1.0 - share) * bend);
}

/* The next tick at which something begins, or ends, that lies within a tick: `part` of it after `at`. */
static int64_t stop_of(int64_t at, double part, int64_t tick, int64_t whole)
{
    if (at > tick)
        return at;
    return part > 0.0 && at == tick ? at + 1 : whole;
}

/* The next tick at which a step has to end: a late command arrives, a late sensor looks, or the sample is over. */
static int64_t next_stop(const Plant *P, int64_t tick, int64_t whole)
{
    int64_t next = stop_of(P->delay_ticks, P->delay_part, tick, whole);

    for (int64_t s = 0; s < P->sensors; s++)
        if (P->sensor_tick[s] > 0) {
            int64_t own = stop_of(P->sensor_tick[s], P->sensor_part[s], tick, whole);
            next = own < next ? own : next;
        }
    return next;
}

/* The voltage from a stop on, V; in the tick in which the command arrives its mean, which moves the rig as far. */
static double voltage_at(const Plant *P, int64_t tick, double before, double after)
{
    if (tick == P->delay_ticks)
        return after + P->delay_part * (before - after);
    return tick < P->delay_ticks ? before : after;
}

/* Present acceleration of a body, m/s^2 or rad/s^2; 0 where it sticks to the ground. */
static double acceleration_of(const Plant *P, State *S, int64_t body, Gap gap)
{
    int contact = S->mode[0] != FREE;
    double theta_d = 0.0;

    set_zero(S->w0, P->channels);
    S->w0[CH_V] = S->now[1];
    if (P->has_base) {
        set_drive_channels(P, S, 0.0, gap.start, gap.rate, S->gear[0]);
        theta_d = P->imposed ? S->gear[0] : screw_angle(P, S, gap.start);
    }
    add_forces(P, S, S->x, S->w0, contact, S->now[0], (Motion){theta_d, drive_rate(P, S, S->x, gap.rate)});
    for (int64_t c = 0; c < P->frictions; c++) {
        int64_t a = P->friction_ends[2 * c], b = P->friction_ends[2 * c + 1];
        if (S->mode[1 + c] != 0)
            continue;
        if (a == GROUND && b == body)
            return 0.0;
        add_effort(P, S->w0, contact, b, S->reaction[c]);
        add_effort(P, S->w0, contact, a, -S->reaction[c]);
    }
    return body_acceleration(P, S->x, S->w0, contact, body);
}

/* Present value of what sensor s measures, SI, before its errors. */
static double read_sensor(const Plant *P, State *S, int64_t s, Gap gap)
{
    const double *sensor = P->sensor + s * N_SENSOR;
    Motion base = {0.0, 0.0};

    if (isnan(sensor[Y_INDEX]))
        return 0.0;
    int64_t index = (int64_t)sensor[Y_INDEX], place = (int64_t)sensor[Y_PLACE];
    if (index >= 0)
        return S->x[index];
    if (P->has_base)
        base = base_motion(P, screw_angle(P, S, gap.start), drive_rate(P, S, S->x, gap.rate));
    if (index == LINK_FORCE)
        return link_force(P, S->x, place, base, S->now[0]);
    if (index == ACCELERATION)
        return acceleration_of(P, S, place, gap);
    return index == BASE_POSITION ? base.at : base.rate;
}

/* What the sensors that look late see at this tick; between two ticks they see what lies between. */
static void catch_late(const Plant *P, State *S, int64_t tick, Gap gap)
{
    for (int64_t s = 0; s < P->sensors; s++) {
        int64_t at = P->sensor_tick[s];
        double part = P->sensor_part[s];
        if (at > 0 && at == tick)
            S->caught[s] = (1.0 - part) * read_sensor(P, S, s, gap);
        else if (at > 0 && part > 0.0 && at + 1 == tick)
            S->caught[s] += part * read_sensor(P, S, s, gap);
    }
}

/* Write what every sensor shows at this sample into y (sensors,): delayed, scaled and offset, no noise. */
static void sense(const Plant *P, State *S, Gap gap, double *y)
{
    for (int64_t s = 0; s < P->sensors; s++) {
        int64_t at = P->sensor_tick[s], place = place_of(P, READING, s);
        double part = P->sensor_part[s], *seen = S->seen + s, value;
        for (int64_t d = P->depth - 1; d > 0; d--)
            seen[d * P->sensors] = seen[(d - 1) * P->sensors];
        seen[0] = at > 0 ? S->caught[s] : read_sensor(P, S, s, gap);
        if (part > 0.0 && at + 1 == P->substeps << (P->levels - 1))
            seen[0] += part * read_sensor(P, S, s, gap);
        value = seen[P->sensor_whole[s] * P->sensors];
        if (P->sensor_play[s] > 0.0)
            value = S->played[s] = play(S->played[s], value, P->sensor_play[s]);
        for (const Law *law = first_law(P, place); law < end_of_laws(P, place); law++)
            value = shown(law, (Reading){value});
        y[s] = value;
    }
}

/* The steps of one sample from time t, each as long as the events and the delays let it be. */
static void take_steps(const Plant *P, State *S, double t, Gap over, Imposed theta)
{
    int last = (int)P->levels - 1, late = P->delay_ticks > 0 || P->delay_part > 0.0, least_level = 0, events = 0;
    int64_t whole = P->substeps << last, tick = 0, end = next_stop(P, 0, whole);
    double before = amplify(P, S->commands[P->delay_whole + late]);
    double after = late ? amplify(P, S->commands[P->delay_whole]) : before;
    double voltage = S->now[1] = voltage_at(P, 0, before, after), tick_s = P->sample_time / (double)whole;

    while (tick < whole) {
        double start = (double)tick * tick_s;
        if (tick == end) {
            voltage = S->now[1] = voltage_at(P, tick, before, after);
            S->now[0] = t + start;
            catch_late(P, S, tick, (Gap){over.start + over.rate * (double)tick * tick_s, over.rate});
            end = next_stop(P, tick, whole);
        }
        int level = least_level;
        while ((int64_t)1 << (last - level) > end - tick)
            level++;
        int64_t ticks = (int64_t)1 << (last - level);
        double h = (double)ticks * tick_s, gap = over.start + over.rate * start, given = S->gear[0];
        if (P->imposed) {
            double angle = imposed_angle(P, theta, (double)(tick + ticks) / (double)whole);
            S->gear[1] = (play(given, angle, gap + over.rate * h) - given) / h;
            turn_base_contacts(P, S, h, given, over.rate);
        }
        try_step(P, S, level, h, t + start, voltage, gap, over.rate, given);
        if (P->imposed && tear_loose(P, S))
            continue;
        gap += over.rate * h;
        Event event = find_event(P, S, gap, over.rate);
        if (event != NO_EVENT && level < last && events < MOST_EVENTS && !is_located(P, S, event, gap, over.rate, h)) {
            least_level = level + 1;
            continue;
        }
        copy(S->xn, S->x, P->n);
        tick += ticks;
        if (P->imposed)
            S->gear[0] = given + S->gear[1] * h;
        if (event != NO_EVENT) {
            switch_gear(P, S, gap, over.rate);
            switch_friction(P, S, t + start + h, gap, over.rate, voltage);
            events++;
            least_level = 0;
        } else if (least_level == last) { /* what a longer step had seen is not there: go on with long steps */
            least_level = 0;
            events++;
        } else if (least_level > 0) {
            least_level++;
        }
    }
}

/* Advance the plant by one sample from time t, s, with a command held over it, V.
 * gap0, gap1 : half-gap at its start and end, rad; linear between. */
static void advance(const Plant *P, State *S, double t, double u, double gap0, double gap1, Imposed theta)
{
    Gap gap = {gap0, (gap1 - gap0) / P->sample_time};

    for (int64_t d = P->delay_whole + 1; d > 0; d--)
        S->commands[d] = S->commands[d - 1];
    S->commands[0] = u;
    if (P->has_base && !P->imposed)
        settle_gear(P, S, gap0, gap1, gap.rate);
    take_steps(P, S, t, gap, theta);
    S->now[0] = t + P->sample_time;
}
