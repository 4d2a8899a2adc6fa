/* When a buffer is full, when the twin's answer is in force, and whether it stays in force: experiment/estimation.py.
 */
#include "core.h"

/* what is less than this share below a half-gap that was taken back is not believed for so many seconds */
static const double LIKE_IT = 0.1, FORGIVEN_S = 60.0;
/* how long a loop has before its new gap is judged, and each of the two stretches that are looked at, s; the motor's
 * span in each that is no cycle, rad, even of a smaller gap */
static const double JUDGED_AFTER_S = 3.0, STRETCH_S = 1.0, SPAN = 0.3;
/* the gap in force grows at most so many times as fast as it grew between the last two answers */
static const double AHEAD = 2.0;

/* ---- the link ---- */

/* An event at sample `event` asks for an estimation from sample `first` on, which may lie before it: memory still holds
 * that. Returns 0 where a buffer fills already: that buffer records the new motion as well. */
int64_t dtb_link_open(TwinLink *L, int64_t event, int64_t first)
{
    if (L->filling)
        return 0;
    L->filling = 1;
    L->event = event;
    L->first = first;
    return 1;
}

/* The sample before which the buffer is full. */
static int64_t full_at(const TwinLink *L) { return L->first + L->length > L->event ? L->first + L->length : L->event; }

/* Whether the buffer is full before sample k; it is handed out once. */
int64_t dtb_link_full(TwinLink *L, int64_t k)
{
    if (!L->filling || k < full_at(L))
        return 0;
    L->filling = 0;
    return 1;
}

/* An answer to the buffer taken at sample k goes on its way; returns its place among (slots,). Answers take effect in
 * the order of their buffers. */
int64_t dtb_link_send(TwinLink *L, int64_t k)
{
    int64_t place = (L->oldest + L->waiting) % L->slots;

    L->due[place] = k + L->delay;
    L->waiting++;
    return place;
}

/* The place of the oldest answer, where it takes effect at sample k or before, once; else -1. */
int64_t dtb_link_arrived(TwinLink *L, int64_t k)
{
    int64_t place = L->oldest;

    if (L->waiting == 0 || L->due[place] > k)
        return -1;
    L->oldest = (place + 1) % L->slots;
    L->waiting--;
    return place;
}

/* The next sample before which a buffer is full or an answer arrives; -1 where none is under way. */
int64_t dtb_link_next(const TwinLink *L)
{
    int64_t due = L->waiting ? L->due[L->oldest] : INT64_MAX, full = L->filling ? full_at(L) : INT64_MAX;
    return L->waiting || L->filling ? least_of(due, full) : -1;
}

/* ---- the half-gap in force ---- */

static int64_t samples_of(const GapInForce *G, double seconds) { return (int64_t)nearbyint(seconds / G->sample_time); }

static void set_in_force(GapInForce *G, double gap, double growth, int64_t k)
{
    G->gap = gap;
    G->growth = growth;
    G->since = k;
}

/* The half-gap at sample k, rad. */
double dtb_gap_at(const GapInForce *G, int64_t k) { return dmax(G->gap + G->growth * (double)(k - G->since), 0.0); }

/* The growth ends where it is due before sample k. */
void dtb_end_growth(GapInForce *G, int64_t k)
{
    if (G->growth != 0.0 && k >= G->until)
        set_in_force(G, dtb_gap_at(G, k), 0.0, k);
}

/* How fast the gap in force goes on growing after an answer, rad/s: what its buffer and the answers both show.
 *
 * The growth since the answer before, so many seconds `between` them, may double or end: it is the mean and the
 * standard deviation of a prior. The growth within the buffer is the measurement. Dry friction looks like growth within
 * a buffer, so the gap is taken to grow at most AHEAD times as fast as it did for sure. A growth that has slowed goes
 * on slowing: half the time between two answers ago it was the one, now it is the other. Where the buffer shows no
 * growth, it does not grow. */
double dtb_growth_ahead(const GapAnswer *now, const GapAnswer *then, double between)
{
    if (between <= 0.0 || !now->guarded || !then->guarded)
        return 0.0;
    double been = (now->gap - then->gap) / between, been_std = hypot(now->std, then->std) / between;
    double most = AHEAD * dmax(fabs(been) - been_std, 0.0), side = copysign(1.0, been);
    if (!(most > 0.0 && isfinite(now->growth_std)))
        return 0.0;
    double prior = been * been + been_std * been_std, seen = now->growth_std * now->growth_std;
    double ahead = (seen * been + prior * now->growth) / (seen + prior);
    return side * dmax(dmin(dmin(side * ahead, side * (2.0 * now->growth - been)), most), 0.0);
}

/* Put an answer in force at sample k: its half-gap, that in the middle of its buffer, and what it has grown since.
 * Returns 0 where it is not: the loop went round in a gap like it. */
int64_t dtb_put_in_force(GapInForce *G, const GapAnswer *answer, int64_t k)
{
    bool cautious = k < G->forgiven;
    double most = cautious ? dmin(G->most, (1.0 - LIKE_IT) * G->condemned) : G->most, growth = 0.0;
    int64_t middle = answer->middle, until = middle + samples_of(G, G->grows_s);

    if (cautious && answer->half_gap > (1.0 - LIKE_IT) * G->condemned)
        return 0;
    if (G->answered)
        growth = dtb_growth_ahead(answer, &G->before, (double)(middle - G->before.middle) * G->sample_time);
    growth *= G->sample_time;
    G->new_since = k;
    G->answered = 1;
    G->before = *answer;
    if (growth > 0.0)
        until =
            least_of(until, middle + (int64_t)dmin(floor(dmax(most - answer->half_gap, 0.0) / growth), MOST_SAMPLES));
    if (growth == 0.0 || until <= middle) {
        set_in_force(G, answer->half_gap, 0.0, k);
        return 1;
    }
    G->until = until;
    double now = dmax(answer->half_gap + growth * (double)(least_of(k, until) - middle), 0.0);
    set_in_force(G, now, until > k ? growth : 0.0, k);
    return 1;
}

/* The sample from which on a new half-gap may be judged, if the reference does not change again; -1 where none is new.
 */
int64_t dtb_judged_at(const GapInForce *G, int64_t last_change)
{
    int64_t begin = G->new_since > last_change ? G->new_since : last_change;
    return G->new_since < 0 ? -1 : begin + samples_of(G, JUDGED_AFTER_S);
}

/* Samples of each of the two stretches before that which are looked at. */
int64_t dtb_stretch(const GapInForce *G) { return samples_of(G, STRETCH_S); }

/* Keep the half-gap in force before sample k as one that rests, or go back to the last such one if the motor goes round
 * in it; returns whether it does. spans (2,) : of the motor's angle in each stretch, rad. In a cycle within the gap it
 * strikes both ends of it, so that it spans twice the half-gap and more. */
int64_t dtb_take_back(GapInForce *G, int64_t k, const double *spans)
{
    double gap = dtb_gap_at(G, k), least = dmax(gap, SPAN);

    G->new_since = -1;
    if (!(spans[0] > least && spans[1] > least)) {
        G->rested = gap;
        return 0;
    }
    set_in_force(G, G->rested, 0.0, k);
    G->answered = 0;
    G->condemned = gap;
    G->forgiven = k + samples_of(G, FORGIVEN_S);
    return 1;
}
