/* The concealing simulator, as one unit: a rig along its samples, with its sensors and its controller. */
#include "laws.c"
#include "step.c"

/* ---- sensors ---- */

/* Row of what sensors looked at so many steps ago. */
static inline const double *seen_before(const Machine *M, const History *H, int64_t steps)
{
    int64_t at = (H->newest - steps) % H->depth;

    return H->seen + (at < 0 ? at + H->depth : at) * M->sensors;
}

/* What sensor s measures at time t, before its errors, SI. */
static double look(const Machine *M, const Memory *S, int64_t s, double t)
{
    const double *Y = M->sensor + s * N_SENSOR;
    int64_t index = (int64_t)Y[Y_INDEX], place = (int64_t)Y[Y_PLACE];

    switch (index) {
    case LINK_FORCE: return link_force(M, S, place, link_stretch(M, S, S->x, place), t);
    case ACCELERATION: return S->rates[2 + M->bodies + place];
    case BASE_POSITION: return S->scalar[S_BASE];
    case BASE_VELOCITY: return S->scalar[S_BASE_RATE];
    default: return S->x[index];
    }
}

/* What sensor s shows, SI: its value Y_DELAY ago, between two entries of the ring, with its errors. A disk off centre
 * by a share of its radius shows the angle of a point on a circle about another centre. */
static double show(const Machine *M, const History *H, int64_t s, double steps)
{
    const double *Y = M->sensor + s * N_SENSOR;
    int64_t whole = (int64_t)steps;
    double part = steps - (double)whole, value = seen_before(M, H, whole)[s];

    if (part > 0.0)
        value += part * (seen_before(M, H, whole + 1)[s] - value);
    double wobble = Y[Y_OFF_CENTRE] * (sin(value + Y[Y_PHASE]) - sin(Y[Y_PHASE]));
    return Y[Y_GAIN] * (value + wobble) + Y[Y_OFFSET];
}

/* What sensor s shows, with what the catalogue does not have, SI; courses (unknowns,). */
static double read_sensor(const Machine *M, const History *H, int64_t s, const double *courses)
{
    const double *Y = M->sensor + s * N_SENSOR;
    double h = M->sample_time / (double)M->substeps, late = Y[Y_DELAY] / h, y = show(M, H, s, late);
    int64_t steps = (int64_t)late;

    if (M->unknowns == 0)
        return y;
    double rate = Y[Y_GAIN] * (seen_before(M, H, steps)[s] - seen_before(M, H, steps + 1)[s]) / h;
    return reading_beyond(M, y, rate, s, courses);
}

/* What all sensors read in sample k, SI; truth, seen (sensors,) : written, without and with noise and counts. */
static void read_sensors(const Machine *M, const Signals *I, const History *H, int64_t k, double *truth, double *seen)
{
    for (int64_t s = 0; s < M->sensors; s++) {
        const double *Y = M->sensor + s * N_SENSOR;
        truth[s] = read_sensor(M, H, s, I->courses + k * M->unknowns);
        seen[s] = truth[s] + Y[Y_NOISE] * I->noise[k * M->sensors + s];
        if (Y[Y_COUNT] > 0.0)
            seen[s] = Y[Y_COUNT] * floor(seen[s] / Y[Y_COUNT] + 0.5);
    }
}

/* ---- controllers ---- */

/* A PID behind a prefilter, V; its rate is filtered, and its integral rests while the command is at its limit. */
static double pid(const double *C, double *F, double measured, double dither)
{
    double error = F[H_SECOND] - measured;

    F[H_RATE] += C[C_CORNER] * (error - F[H_RATE]);
    double v = C[C_GAIN] * error + F[H_INTEGRAL] + C[C_RATE] * (error - F[H_RATE]) + dither;
    if (fabs(v) < C[C_LIMIT])
        F[H_INTEGRAL] += C[C_INTEGRAL] * error;
    return v;
}

/* The command of sample k, V; seen (sensors,). A prefilter, then a P controller of the motor's angle with a slow
 * integral; or a PID. */
static double command(const Machine *M, Memory *S, const Signals *I, const double *seen, int64_t k)
{
    const double *C = I->control;
    double r = I->reference[k], *F = S->control, lead = M->drive[D_LEAD], v;

    if ((int)C[C_MODE] == OPEN)
        return r + I->dither[k];
    F[H_FIRST] += C[C_FILTER] * (r - F[H_FIRST]);
    F[H_SECOND] += C[C_FILTER] * (F[H_FIRST] - F[H_SECOND]);
    if ((int)C[C_MODE] == PID) {
        v = pid(C, F, seen[I->roles[0]], I->dither[k]);
    } else {
        F[H_INTEGRAL] += C[C_INTEGRAL] * (F[H_SECOND] - seen[I->roles[1]]) / lead;
        v = C[C_GAIN] * (F[H_SECOND] / lead + F[H_INTEGRAL] - seen[I->roles[0]]) + I->dither[k];
    }
    return smaller(larger(v, -C[C_LIMIT]), C[C_LIMIT]);
}

/* Set out for the position of the next sample: a positioner knows its course, which is given. */
static void impose(const Machine *M, Memory *S, const Signals *I, double u, int64_t k)
{
    double travel = M->drive[D_TRAVEL], following = I->reference[k + 1] + I->dither[k + 1];

    S->scalar[S_FROM] = travel * u;
    S->scalar[S_SINCE] = (double)k * M->sample_time;
    S->scalar[S_IMPOSED_RATE] = travel * (following - u) / M->sample_time;
}

/* ---- samples ---- */

/* Courses of what the catalogue does not have, at both ends of a step: shares of sample k. */
static void set_courses(const Machine *M, Memory *S, const Signals *I, int64_t k, double begin, double end)
{
    int64_t n = M->unknowns;
    const double *before = I->courses + k * n, *after = before + n;

    for (int64_t r = 0; r < n; r++) {
        S->course[n + r] = before[r] + begin * (after[r] - before[r]);
        S->course[2 * n + r] = before[r] + end * (after[r] - before[r]);
    }
}

/* Whether a sensor shows an acceleration. */
static int accelerates(const Machine *M)
{
    for (int64_t s = 0; s < M->sensors; s++)
        if ((int)M->sensor[s * N_SENSOR + Y_INDEX] == ACCELERATION)
            return 1;
    return 0;
}

/* All steps from sample k to the next; u (N,) the commands so far, V. */
static void advance_sample(const Machine *M, Memory *S, const Signals *I, History *H, const double *u, int64_t k)
{
    double steps = (double)M->substeps, h = M->sample_time / steps;
    int rates = accelerates(M);

    for (int64_t j = 0; j < M->substeps; j++) {
        double begin = (double)j / steps, end = (double)(j + 1) / steps, volt = voltage(M, u, k, begin, end);
        double t = ((double)k + end) * M->sample_time;
        set_courses(M, S, I, k, begin, end);
        advance(M, S, ((double)k + begin) * M->sample_time, h, volt);
        H->newest = (H->newest + 1) % H->depth;
        if (rates) /* at the step's end, after what has happened in it */
            derivative(M, S, S->x, t, volt, S->rates);
        for (int64_t s = 0; s < M->sensors; s++)
            H->seen[H->newest * M->sensors + s] = look(M, S, s, t);
    }
}

/* Run N samples; returns how many stayed finite. u (N,) V, truth and seen (N, sensors) SI without and with noise and
 * counts, states (N, 2 + 2 bodies) : written. */
int64_t dtb_run_machine(const Machine *M, Memory *S, const Signals *I, History *H, double *u, double *truth,
                        double *seen, double *states)
{
    int64_t n = states_of(M);

    for (int64_t k = 0; k < I->samples; k++) {
        double *read = seen + k * M->sensors;
        read_sensors(M, I, H, k, truth + k * M->sensors, read);
        for (int64_t i = 0; i < n; i++)
            states[k * n + i] = S->x[i];
        u[k] = command(M, S, I, read, k);
        if (!isfinite(u[k]) || !(fabs(S->x[2]) < 1e6))
            return k;
        if (k + 1 == I->samples)
            break;
        if (M->drive[D_TRAVEL] != 0.0)
            impose(M, S, I, u[k], k);
        advance_sample(M, S, I, H, u, k);
    }
    return I->samples;
}
