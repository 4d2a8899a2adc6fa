/* The twin beside the controller: what it records, when it is asked, and what becomes of its answer.
 *
 * twin_step() belongs into the interrupt that takes the samples, twin_estimate() into the background of the same
 * processor. An estimate may take as long as the delay of the link (twin.delay_s): only then its answer is in force.
 * A later one is in force when it is there.
 */

enum { NOTHING, REQUESTED, ANSWERED };

/* What stands before this is read and written before what follows: an interrupt may come between. */
#ifdef __GNUC__
#define KEEP_ORDER() __asm__ volatile("" ::: "memory")
#else
#define KEEP_ORDER() ((void)0)
#endif

/* Samples from number `first` on. */
typedef struct {
    int64_t first, count;
    double theta_m[SAMPLES], q3[SAMPLES];
} Recording;

typedef struct {
    controller c;
    int64_t k, last_change; /* the next sample; that at which the reference changed last */
    double reference;
    int moving;                /* whether the reference changed at the last sample */
    Recording record[3];       /* since the last change; that which fills; that which is estimated from: */
    int latest, filling, work; /* places of these, -1: none */
    volatile int state;        /* of the request: step asks, estimate answers */
    int64_t sent;              /* sample at which it was */
    double present;            /* half-gap in force then, rad */
    GapAttempt found;          /* the last estimate, with the verdict on it */
    GapInForce in_force;
    TwinLink link;
    int64_t due[SLOTS];
    GapAnswer on_the_way[SLOTS];
    int rejected;                    /* the last estimate was, and the novelty index has been high since */
    double level, lock[LOCK_STATES]; /* novelty, m, and the state of its filter */
    double low[2], high[2];          /* of the motor's angle in the stretches by which a new gap is judged, rad */
    double eps_q[SAMPLES], other_eps_q[SAMPLES], room[6 * LAGS_MOST], profile[2 * SCANS], other[2 * SCANS];
} twin_controller;

/* A place for a new recording, beside that which fills, that which is estimated from, and one more (-1: none). */
static int free_place(const twin_controller *t, int beside)
{
    int place = 0;

    while (place == beside || place == t->filling || (t->state != NOTHING && place == t->work))
        place++;
    return place;
}

static void begin_recording(twin_controller *t, int place)
{
    t->record[place].first = t->k;
    t->record[place].count = 0;
}

static void append(Recording *to, double theta_m, double q3)
{
    if (to->count < SAMPLES) {
        to->theta_m[to->count] = theta_m;
        to->q3[to->count] = q3;
        to->count++;
    }
}

/* An answer that has come goes on its way; those that are due are put in force. */
static void take_answers(twin_controller *t)
{
    if (t->state == ANSWERED) {
        const GapEstimate *e = &t->found.estimate;
        t->rejected = !t->found.accepted;
        if (t->found.accepted)
            t->on_the_way[dtb_link_send(&t->link, t->sent)] = (GapAnswer){t->found.applied,
                                                                          e->gap,
                                                                          e->std,
                                                                          e->growth,
                                                                          e->growth_std,
                                                                          GUARDED,
                                                                          t->record[t->work].first + SAMPLES / 2};
        t->state = NOTHING;
    }
    for (int64_t i = dtb_link_arrived(&t->link, t->k); i >= 0; i = dtb_link_arrived(&t->link, t->k))
        dtb_put_in_force(&t->in_force, t->on_the_way + i, t->k);
}

/* Where the reference r, m, begins to change, a new recording begins; with ON_CHANGE the twin is asked. */
static void note_change(twin_controller *t, double r)
{
    int changed = t->k > 0 && r != t->reference, begins = changed && !(ONSETS && t->moving);

    t->reference = r;
    t->moving = changed;
    if (!begins)
        return;
    t->last_change = t->k;
    t->latest = free_place(t, -1);
    begin_recording(t, t->latest);
    if (ON_CHANGE && dtb_link_open(&t->link, t->k, t->k))
        t->filling = t->latest;
}

/* The novelty index has risen: the motion that it rose in is recorded still. The same samples would say the same after
 * a rejected estimate: that is followed by a new recording. */
static void raise_alarm(twin_controller *t)
{
    if (!dtb_link_open(&t->link, t->k, t->rejected ? t->k : t->last_change))
        return;
    t->filling = t->rejected ? free_place(t, t->latest) : t->latest;
    if (t->rejected)
        begin_recording(t, t->filling);
}

/* The span of the motor's angle, rad, in the stretches before the sample at which the new half-gap is judged. */
static void watch_span(twin_controller *t, double theta_m)
{
    int64_t judged = dtb_judged_at(&t->in_force, t->last_change), stretch = dtb_stretch(&t->in_force);
    int64_t at = t->k - (judged - 2 * stretch);

    if (judged < 0 || at < 0 || at >= 2 * stretch)
        return;
    double *low = t->low + at / stretch, *high = t->high + at / stretch;
    *low = at % stretch == 0 ? theta_m : dmin(*low, theta_m);
    *high = at % stretch == 0 ? theta_m : dmax(*high, theta_m);
}

/* What is due before the next sample: the end of a growth, a judgement, a full buffer. */
static void end_step(twin_controller *t)
{
    const double spans[2] = {t->high[0] - t->low[0], t->high[1] - t->low[1]};

    dtb_end_growth(&t->in_force, t->k);
    int64_t judged = dtb_judged_at(&t->in_force, t->last_change);
    if (judged >= 0 && t->k >= judged)
        dtb_take_back(&t->in_force, t->k, spans);
    if (t->state == NOTHING && dtb_link_full(&t->link, t->k)) {
        t->work = t->filling;
        t->filling = -1;
        t->sent = t->k;
        t->present = dtb_gap_at(&t->in_force, t->k);
        t->state = REQUESTED;
    }
}

/* Before the first step; y as for controller_start(). */
void twin_start(twin_controller *t, const double y[2])
{
    memset(t, 0, sizeof *t);
    controller_start(&t->c, y);
    t->filling = t->work = -1;
    t->in_force = (GapInForce){.sample_time = SAMPLE_TIME,
                               .grows_s = GROWS_S,
                               .most = GAP_BOUND,
                               .gap = FIRST_HALF_GAP,
                               .rested = FIRST_HALF_GAP,
                               .condemned = INFINITY,
                               .new_since = -1,
                               .forgiven = -1};
    t->link = (TwinLink){.length = SAMPLES, .delay = DELAY, .slots = SLOTS, .due = t->due};
    t->lock[0] = 1.0;
}

/* One sample: see controller_step(). */
double twin_step(twin_controller *t, double r, const double y[2])
{
    const LockIn lock = {SECTIONS, COS_STEP, SIN_STEP, SOS, t->lock};

    take_answers(t);
    note_change(t, fabs(r) <= SANE ? r : t->c.good[0]);
    int listens = !ON_CHANGE && t->state == NOTHING && dtb_link_next(&t->link) < 0;
    t->c.half_gap = dtb_gap_at(&t->in_force, t->k);
    t->c.growth = t->in_force.growth;
    t->c.grows = t->in_force.growth != 0.0 ? 1.0 : 0.0;
    double u = controller_step(&t->c, r, y), before = t->rejected ? 0.0 : t->level;
    append(t->record + t->latest, t->c.good[1], t->c.good[2]);
    if (t->filling >= 0 && t->filling != t->latest)
        append(t->record + t->filling, t->c.good[1], t->c.good[2]);
    watch_span(t, t->c.good[1]);
    t->level = lock_in(&lock, t->c.eps);
    t->k++;
    if (listens && t->level > THRESHOLD && !(before > THRESHOLD))
        raise_alarm(t);
    if (listens)
        t->rejected = 0;
    end_step(t);
    return u;
}

/* Estimate the gap, where that is asked for, into t->found; returns whether it was. */
int twin_estimate(twin_controller *t)
{
    const Optimizer by = {.most = EVALUATIONS, .tolerance = TOLERANCE};
    GapAttempt tried[ATTEMPTS];
    double start[2];

    if (t->state != REQUESTED)
        return 0;
    KEEP_ORDER();
    const Recording *from = t->record + t->work;
    const TwinProblem problem = {.model = &MODEL,
                                 .data = {SAMPLES, MODEL.settle, from->theta_m, t->eps_q, MODEL.from_theta_d},
                                 .q3 = from->q3,
                                 .room = t->room};
    copy(from->q3, t->eps_q, SAMPLES);
    dtb_filter(&MODEL.from_q3, SAMPLES, t->eps_q, t->room);
    default_start(&problem, t->present, start);
    if (GUARDED) {
        Guard guard = {&problem, &WRONG, &ASK, t->present, t->other_eps_q, t->profile, t->other, 0};
        t->found = tried[outcome_of(attempt_all(&guard, &by, start, tried), tried)];
    } else {
        GapEstimate e = estimate(&problem, &by, start);
        t->found = (GapAttempt){e, isfinite(e.fit_gap) != 0, 0, 0, UNGUARDED, e.fit_gap, e.fit_gap};
    }
    KEEP_ORDER();
    t->state = ANSWERED;
    return 1;
}
