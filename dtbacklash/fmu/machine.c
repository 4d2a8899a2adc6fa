/* The rig above as a slave of an FMU: the core's own steps, at rest at first.
 *
 * Above stand its numbers: RIG, a Plant with its arrays; VARIABLES, inputs, then outputs, then parameters, by their
 * value references; and assemble(), which writes what follows from the parameters into the slave. */
static const double SLACK = 1e-3; /* of a sample, by which a communication point may lie beside the one that it means */
static const double PER_DEG = 3.14159265358979323846 / 180.0;
enum { COMMAND_V, GAP_DEG, HAS_GAP = INPUTS > 1, TIME = INPUTS + OUTPUTS + PARAMETERS, FIRST_PARAMETER = INPUTS + OUTPUTS };

/* Let the structs point to the slave's own arrays. */
static void bind(Slave *s)
{
    Plant before = s->P;

    s->P = RIG; /* pointers of another process do not stay; the delay is a parameter's */
    s->P.delay_whole = before.delay_whole, s->P.delay_ticks = before.delay_ticks, s->P.delay_part = before.delay_part;
    memcpy(s->law, LAWS, sizeof LAWS);
    for (int k = 0; k < ENTRIES; k++)
        s->law[k].p = s->law_p + k * ROW;
    s->P.E = s->E, s->P.P1 = s->P1, s->P.P2 = s->P2, s->P.A = s->A, s->P.G = s->G;
    s->P.law = s->law, s->P.link = s->link, s->P.circuit = s->circuit, s->P.screw = s->screw;
    s->S = (State){s->x, s->gear, s->mode, s->commands, s->seen, s->caught, s->played, s->xn, s->xp, s->w0, s->w1,
                   s->lean, s->reaction, s->load, s->now};
}

/* As instantiated: inputs and parameters as described, at rest. */
static int anew(Slave *s)
{
    Journal own = s->journal;

    memset(s, 0, sizeof *s);
    s->journal = own;
    for (int k = 0; k < TIME; k++)
        s->value[k] = VARIABLES[k].start;
    return OK;
}

/* What an input or a parameter may not be. */
static int check(const Slave *s, int k)
{
    const Variable *v = VARIABLES + k;
    double value = s->value[k];

    if (!isfinite(value))
        return tell(&s->journal, "%s=%g: must be finite", v->name, value);
    if (value < v->least || (v->above && value == v->least))
        return tell(&s->journal, "%s=%g: must be %s %g", v->name, value, v->above ? "above" : "at least", v->least);
    if (value > v->most)
        return tell(&s->journal, "%s=%g: must be at most %g", v->name, value, v->most);
    return OK;
}

/* The amplifier's delay in whole samples, ticks of a sample, and a part of a tick; a part below 1e-6 is rounding. */
static int set_delay(Slave *s, double seconds)
{
    int64_t ticks = RIG.substeps << (RIG.levels - 1);
    double total = seconds / RIG.sample_time * (double)ticks;
    int64_t whole = (int64_t)(total + 1e-6);
    double part = dmax(total - (double)whole, 0.0);

    if (whole / ticks > COMMANDS - 2)
        return tell(&s->journal, "the amplifier's delay may be %g s at most: export the rig with a longer one",
                    (COMMANDS - 2) * RIG.sample_time);
    s->P.delay_whole = whole / ticks;
    s->P.delay_ticks = whole % ticks;
    s->P.delay_part = part > 1e-6 ? part : 0.0;
    return OK;
}

static int all_finite(const double *x, int64_t n)
{
    for (int64_t i = 0; i < n; i++)
        if (!isfinite(x[i]))
            return 0;
    return 1;
}

/* Run samples with the inputs as they are, and show what they end at. */
static void run(Slave *s, int64_t samples)
{
    double gap = (HAS_GAP ? s->value[GAP_DEG] * PER_DEG : 0.0) + s->own_gap;

    if (!s->made)
        s->gap = gap;
    dtb_hold(&s->P, &s->S, s->start, s->samples, samples, s->value[COMMAND_V], s->gap, gap, s->window, WINDOW, HERE, s->y);
    s->gap = gap;
    s->samples += samples;
    for (int k = 0; k < OUTPUTS; k++)
        s->value[INPUTS + k] = s->y[SHOWN[k]] * VARIABLES[INPUTS + k].factor;
}

static int check_inputs(const Slave *s)
{
    for (int k = 0; k < INPUTS; k++)
        if (check(s, k) != OK)
            return WRONG;
    return OK;
}

/* The machine of the values so far, at rest. */
static int make(Slave *s)
{
    const char *frozen;
    double delay = 0.0, room[5 * RIG_N * RIG_N];

    if (s->made)
        return OK;
    if (check_inputs(s) != OK)
        return WRONG;
    for (int k = FIRST_PARAMETER; k < TIME; k++)
        if (check(s, k) != OK)
            return WRONG;
    if ((frozen = assemble(s, s->value + FIRST_PARAMETER, &delay)))
        return tell(&s->journal, "the parameters make another machine (%s): export the rig with them", frozen);
    if (!all_finite(s->A, 2 * RIG_N * RIG_N) || !all_finite(s->G, 2 * RIG_CHANNELS * RIG_N) ||
        !all_finite(s->link, N_LINK * RIG.links) || !all_finite(s->screw, N_SCREW))
        return tell(&s->journal, "the parameters make no machine: numbers of it are not finite");
    if (set_delay(s, delay) != OK)
        return WRONG;
    bind(s);
    dtb_discretise(2, RIG_N, RIG_CHANNELS, RIG.levels, s->A, s->G, RIG.sample_time / (double)RIG.substeps, s->E, s->P1,
                   s->P2, room);
    s->mode[0] = RIG.imposed ? FREE : RIGID;
    for (int k = 0; k < WINDOW; k++)
        s->window[k] = s->value[COMMAND_V];
    if (RIG.imposed) {
        s->gear[0] = s->value[COMMAND_V];
        for (int64_t j = 0; j < RIG.bodies; j++)
            s->x[RIG.position + j] = (j == RIG.rotor ? 1.0 : s->screw[S_LEAD]) * s->value[COMMAND_V];
    }
    run(s, 0);
    s->made = 1;
    return OK;
}

static int start(Slave *s, double time)
{
    s->start = time;
    s->made = 0;
    return OK;
}

static int begin(Slave *s)
{
    if (make(s) != OK)
        return WRONG;
    s->begun = 1;
    return OK;
}

static int put(Slave *s, const unsigned *which, size_t n, const double *values)
{
    for (size_t i = 0; i < n; i++) {
        unsigned k = which[i];
        if (k >= TIME || (k >= INPUTS && k < FIRST_PARAMETER))
            return tell(&s->journal, "%s=%g: is an output", k < TIME ? VARIABLES[k].name : "time", values[i]);
        if (k >= FIRST_PARAMETER && s->begun)
            return tell(&s->journal, "%s=%g: is fixed; set it before the initialization ends", VARIABLES[k].name,
                        values[i]);
        s->value[k] = values[i];
        s->made = s->begun;
    }
    return OK;
}

static int show(Slave *s, const unsigned *which, size_t n, double *values)
{
    for (size_t i = 0; i < n; i++) {
        unsigned k = which[i];
        if (k > TIME)
            return tell(&s->journal, "there is no value reference %u", k);
        if (k >= INPUTS && k < FIRST_PARAMETER && make(s) != OK)
            return WRONG;
        values[i] = k == TIME ? s->start + (double)s->samples * RIG.sample_time : s->value[k];
    }
    return OK;
}

static int move(Slave *s, double now, double seconds)
{
    double step = RIG.sample_time, at = s->start + (double)s->samples * step, samples = floor(seconds / step + 0.5);

    if (!(samples >= 1.0 && fabs(seconds - samples * step) <= SLACK * step))
        return tell(&s->journal, "communication step %g s: must be a multiple of the sample time %g s", seconds, step);
    if (!(fabs(now - at) <= SLACK * step))
        return tell(&s->journal, "communication point %.9g s: must be %.9g s, where the last step has ended", now, at);
    if (make(s) != OK || check_inputs(s) != OK)
        return WRONG;
    run(s, (int64_t)samples);
    if (!all_finite(s->y, RIG.sensors + 1))
        return tell(&s->journal, "the rig has run away before t = %.9g s", at + samples * step);
    return OK;
}
