/* The controller above as a slave of an FMU. The voltage is that of the values that are set now; a step takes it, and
 * moves on by whole samples. */
enum { REFERENCE, ANGLE, OUTPUT, HALF_GAP, VOLTAGE, HELD, TIME }; /* value references */

typedef struct {
    Journal journal;
    controller c;
    double in[HALF_GAP + 1], time;
    int begun;
} Slave;

static void bind(Slave *s) { (void)s; }
static void at_rest(Slave *s) { controller_reset(&s->c, s->in + ANGLE); }

static int anew(Slave *s)
{
    Journal own = s->journal;

    memset(s, 0, sizeof *s);
    s->journal = own;
    s->in[HALF_GAP] = s->c.half_gap = FIRST_HALF_GAP;
    return OK;
}

static int start(Slave *s, double time)
{
    s->time = time;
    return OK;
}

static int begin(Slave *s)
{
    at_rest(s);
    s->begun = 1;
    return OK;
}

static int put(Slave *s, const unsigned *which, size_t n, const double *values)
{
    for (size_t i = 0; i < n; i++) {
        if (which[i] > HALF_GAP)
            return tell(&s->journal, "value reference %u cannot be set", which[i]);
        if (which[i] == HALF_GAP && !controller_set_gap(&s->c, values[i], 0.0, 0.0))
            return tell(&s->journal, "half_gap=%g: must be at least 0 and at most %g rad", values[i], GAP_MOST);
        s->in[which[i]] = values[i];
    }
    return OK;
}

static int show(Slave *s, const unsigned *which, size_t n, double *values)
{
    for (size_t i = 0; i < n; i++) {
        Slave now = *s;
        if (which[i] > TIME)
            return tell(&s->journal, "there is no value reference %u", which[i]);
        if (!now.begun)
            at_rest(&now);
        values[i] = which[i] == VOLTAGE ? controller_step(&now.c, now.in[REFERENCE], now.in + ANGLE)
                    : which[i] == HELD  ? (double)now.c.held
                    : which[i] == TIME  ? now.time
                                        : now.in[which[i]];
    }
    return OK;
}

static int move(Slave *s, double now, double seconds)
{
    double samples = floor(seconds / SAMPLE_TIME + 0.5);

    if (!(samples >= 1.0 && fabs(seconds / SAMPLE_TIME - samples) < 1e-6 * samples))
        return tell(&s->journal, "communication step %g s at %.9g s: must be a multiple of the sample time %g s",
                    seconds, now, SAMPLE_TIME);
    for (double k = 0.0; k < samples; k++)
        controller_step(&s->c, s->in[REFERENCE], s->in + ANGLE);
    s->time += seconds;
    return OK;
}
