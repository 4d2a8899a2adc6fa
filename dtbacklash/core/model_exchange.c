/* A step of an FMU for Model Exchange: its own functions, called at their addresses.
 *
 * The Runge-Kutta method of fourth order goes over the continuous states. Dry friction holds what it can by an impulse
 * after each step: one evaluation a joint says how its force changes the accelerations, and the force that stops all
 * joints at once is cut to the levels (projected Gauss-Seidel; Moreau's time-stepping: Acary and Brogliato, Numerical
 * Methods for Nonsmooth Dynamical Systems (2008), chapter 10). The force of a step goes on in the next one, so that
 * sliding is as accurate as the method. What switches in the FMU ends a part of the step. */
#include "core.h"

/* the clock of steps is that of the FMU up to such a part of a step: it is a sum of them */
static const double ROUNDING = 1e-6;
/* parts of a step that need not be halved to find when something switches */
static const double SHORTEST = 1.0 / 64.0;
/* an FMI status above a warning is above this; turns in which the forces of several joints find each other */
enum { WARNING = 1, SWEEPS = 20 };
/* Runge-Kutta: how far into the step, and how much each slope counts */
enum { STAGES = 4 };
static const double STAGE[STAGES] = {0.0, 0.5, 0.5, 1.0};
static const double WEIGHT[STAGES] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};

static inline int worse(int status, int other) { return status > other ? status : other; }

/* ---- functions whose arguments differ between FMI 2.0 and 3.0 ---- */

static int set_inputs(const Fmu *F)
{
    size_t named = (size_t)F->inputs_named;
    if (F->threes)
        return ((int (*)(void *, const uint32_t *, size_t, const double *, size_t))F->set_inputs)(
            F->instance, F->input_names, named, F->given, (size_t)F->inputs);
    return ((int (*)(void *, const uint32_t *, size_t, const double *))F->set_inputs)(F->instance, F->input_names,
                                                                                      named, F->given);
}

static void get_outputs(const Fmu *F)
{
    size_t named = (size_t)F->outputs_named;
    if (F->threes)
        ((int (*)(void *, const uint32_t *, size_t, double *, size_t))F->get_outputs)(
            F->instance, F->output_names, named, F->shown, (size_t)F->outputs);
    else
        ((int (*)(void *, const uint32_t *, size_t, double *))F->get_outputs)(F->instance, F->output_names, named,
                                                                              F->shown);
}

/* Say that a step has been completed; whether the FMU asks for an event. */
static int complete(const Fmu *F)
{
    if (F->threes) {
        bool event = false, ends = false;
        ((int (*)(void *, bool, bool *, bool *))F->completed)(F->instance, true, &event, &ends);
        return event;
    }
    int event = 0, ends = 0;
    ((int (*)(void *, int, int *, int *))F->completed)(F->instance, 1, &event, &ends);
    return event;
}

/* One turn of an event. */
static EventInfo decide(const Fmu *F)
{
    EventInfo info = {0};
    if (F->threes) {
        bool again = false, ends = false, nominals = false, moved = false, strikes = false;
        ((int (*)(void *, bool *, bool *, bool *, bool *, bool *, double *))F->decide)(
            F->instance, &again, &ends, &nominals, &moved, &strikes, &info.next);
        info = (EventInfo){again, ends, nominals, moved, strikes, info.next};
    } else
        ((int (*)(void *, EventInfo *))F->decide)(F->instance, &info);
    return info;
}

/* ---- what the FMU is told, and says ---- */

static int set_states(const Fmu *F)
{
    for (int64_t k = 0; k < F->states; k++)
        F->theirs[F->order[k]] = F->x[k];
    return F->set_states(F->instance, F->theirs, (size_t)F->states);
}

/* Give the FMU time, states, commands and forces; its status. */
static int set_all(const Fmu *F, double time)
{
    const double *speed = F->x + F->joints;
    int status = worse(F->set_time(F->instance, time), set_states(F));

    copy(F->still, F->given, F->inputs);
    for (int64_t k = 0; k < F->commands; k++)
        F->given[F->input[k]] = F->ctrl[k];
    for (int64_t k = 0; k < F->joints; k++)
        if (F->force[k] >= 0)
            F->given[F->force[k]] += F->push[k] + F->held[k] * F->friction[k] - F->damping[k] * speed[k];
    return worse(status, set_inputs(F));
}

/* Derivatives at the states and forces; whether the FMU gives them. alike : time and inputs stay. */
static int find_rates(const Fmu *F, double time, int alike)
{
    int status = alike ? set_states(F) : set_all(F, time);

    status = worse(status, F->get_rates(F->instance, F->theirs_rate, (size_t)F->states));
    for (int64_t k = 0; k < F->states; k++)
        F->rate[k] = F->theirs_rate[F->order[k]];
    for (int64_t k = 0; k < F->joints; k++)
        if (F->force[k] < 0) /* no force: an acceleration, of the linear part alone */
            F->rate[F->joints + k] += F->push[k];
    return status <= WARNING;
}

/* Whether an indicator has changed its sign, at a time. */
static int has_turned(const Fmu *F, double time)
{
    set_all(F, time);
    F->get_signs(F->instance, F->sign, (size_t)F->signs);
    for (int64_t k = 0; k < F->signs; k++)
        if ((F->sign[k] > 0.0) != (F->before[k] > 0.0))
            return 1;
    return 0;
}

/* At the end of a step let the FMU switch, where an indicator changed its sign, its clock struck, or it asks to. */
static void let_switch(Fmu *F)
{
    int struck = *F->clock >= F->next - ROUNDING * F->step, moved = 0;
    EventInfo info = {0};

    if (struck)
        *F->clock = dmax(*F->clock, F->next);
    set_all(F, *F->clock);
    int asks = complete(F), turned = has_turned(F, *F->clock);
    copy(F->sign, F->before, F->signs);
    if (!asks && !struck && !turned)
        return;
    F->begin_event(F->instance);
    for (int64_t turn = 0; turn < F->decisions; turn++) {
        info = decide(F);
        moved = moved || info.moved;
        if (!info.again)
            break;
    }
    F->next = info.strikes ? info.next : INFINITY;
    F->end_event(F->instance);
    if (moved) {
        F->get_states(F->instance, F->theirs, (size_t)F->states);
        for (int64_t k = 0; k < F->states; k++)
            F->x[k] = F->theirs[F->order[k]];
    }
    F->get_signs(F->instance, F->sign, (size_t)F->signs);
    copy(F->sign, F->before, F->signs);
}

/* ---- dry friction ---- */

/* What the shares that hold have added to a joint's speed since they were marked. */
static double gained(const Fmu *F, int64_t k)
{
    double more = 0.0;
    for (int64_t i = 0; i < F->joints; i++)
        more += F->pair[k * F->joints + i] * (F->held[i] - F->mark[i]);
    return more;
}

/* Whether all joints slide on as they did. */
static int slide_on(const Fmu *F)
{
    for (int64_t k = 0; k < F->joints; k++)
        if (F->friction[k] != 0.0 && !(fabs(F->held[k]) == 1.0 && F->held[k] * F->x[F->joints + k] < 0.0))
            return 0;
    return 1;
}

/* What each joint's force adds to all speeds in a time h, into pair; a joint without friction has no column there. */
static void find_pairs(const Fmu *F, double time, double h)
{
    int64_t n = F->joints;

    copy(F->rate, F->rest, F->states);
    copy(F->held, F->mark, n);
    set_zero(F->pair, n * n);
    for (int64_t k = 0; k < n; k++) {
        if (!(F->friction[k] > 0.0))
            continue;
        F->held[k] += 1.0;
        find_rates(F, time, 0);
        F->held[k] = F->mark[k];
        for (int64_t i = 0; i < n; i++)
            F->pair[i * n + k] = (F->rate[n + i] - F->rest[n + i]) * h;
    }
}

/* Let dry friction stop, after a step, what it can. */
static void hold(const Fmu *F, double time, double h)
{
    int64_t n = F->joints;

    if (slide_on(F) || !find_rates(F, time, 0))
        return;
    find_pairs(F, time, h);
    for (int sweep = 0; sweep < SWEEPS; sweep++)
        for (int64_t k = 0; k < n; k++) {
            double gives = F->pair[k * n + k];
            if (gives > 0.0) {
                double held = F->held[k] - (F->x[n + k] + gained(F, k)) / gives;
                F->held[k] = held > -1.0 ? dmin(1.0, held) : -1.0;
            }
        }
    for (int64_t k = 0; k < n; k++) {
        double more = gained(F, k);
        F->x[n + k] += more;
        F->x[k] += 0.5 * h * more;
    }
}

/* ---- steps ---- */

static void find_efforts(const Fmu *F)
{
    for (int64_t k = 0; k < F->joints; k++) {
        F->load[k] = 0.0;
        for (int64_t i = 0; i < F->commands; i++)
            F->load[k] += F->share[k * F->commands + i] * F->ctrl[i];
    }
}

/* Over a time h, without what holds or switches; whether the FMU gave its derivatives. */
static int runge_kutta(const Fmu *F, double time, double h)
{
    int good = 1, damped = 0;

    for (int64_t k = 0; k < F->joints; k++)
        damped = damped || F->damping[k] != 0.0;
    copy(F->x, F->begun, F->states);
    set_zero(F->total, F->states);
    for (int s = 0; s < STAGES; s++) {
        for (int64_t k = 0; s && k < F->states; k++)
            F->x[k] = F->begun[k] + STAGE[s] * h * F->rate[k];
        good = find_rates(F, time + STAGE[s] * h, s == 2 && !damped) && good;
        for (int64_t k = 0; k < F->states; k++)
            F->total[k] += WEIGHT[s] * F->rate[k];
    }
    for (int64_t k = 0; k < F->states; k++)
        F->x[k] = F->begun[k] + h * F->total[k];
    return good;
}

/* One step, in parts where something switches in it, of which halves are taken; NaN where the FMU refuses. */
void dtb_fmu_step(void *model, void *data)
{
    Fmu *F = model;
    double begun = *F->clock, h = F->step, part = h;
    int good = 1, rubbed = 0;
    (void)data;

    find_efforts(F);
    for (int64_t k = 0; k < F->joints; k++)
        rubbed = rubbed || F->friction[k] != 0.0;
    while (part > ROUNDING * h) {
        double time = *F->clock;
        if (F->follows && F->next > time + ROUNDING * h)
            part = dmin(part, F->next - time);
        good = runge_kutta(F, time, part) && good;
        if (F->follows && part > SHORTEST * h && has_turned(F, time + part)) {
            copy(F->begun, F->x, F->states);
            part *= 0.5;
            continue;
        }
        if (rubbed)
            hold(F, time + part, part);
        *F->clock = time + part;
        if (F->follows)
            let_switch(F);
        part = begun + h - *F->clock;
    }
    for (int64_t k = 0; !good && k < F->states; k++)
        F->x[k] = NAN;
}

/* Accelerations and outputs of the state. */
void dtb_fmu_forward(void *model, void *data)
{
    const Fmu *F = model;
    (void)data;

    find_efforts(F);
    find_rates(F, *F->clock, 0);
    if (F->outputs)
        get_outputs(F);
}

/* Back to the first time: states are put after that, and its clock strikes nowhere in the linear part. */
void dtb_fmu_back(void *model, void *data)
{
    (void)data;
    *((Fmu *)model)->clock = 0.0;
}
