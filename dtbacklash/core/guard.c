/* The guard between the twin and the controller, which judges estimates from one buffer: twin/gap/guard.py. */
#include "core.h"

/* costs on a plateau differ by no more than this share */
static const double PLATEAU = 1e-6;

/* Whether a half-gap, rad, lies outside the physical bounds, or is no number. */
static bool impossible(const GuardSettings *ask, double gap)
{
    return !(isfinite(gap) && gap >= -1e-3 * DEGREE && gap <= ask->gap_most);
}

/* How far the gear moved the screw while the cost was looking, rad, by an estimate. */
static double contact_travel(const TwinProblem *problem, const GapEstimate *e)
{
    const TwinBuffer *in = &problem->data;
    int64_t memory = (int64_t)nearbyint(4.0 / (problem->model->pole * problem->model->sample_time));
    double theta_d = e->theta_d0, total = 0.0;

    for (int64_t k = 0; k < in->samples; k++) {
        double next = play(theta_d, in->theta_m[k], e->gap);
        if (k > 0 && k > in->settle - memory)
            total += fabs(next - theta_d);
        theta_d = next;
    }
    return total;
}

/* Whether a half-gap is not one of the estimate's own valley. */
static bool far_from(const GuardSettings *ask, const GapEstimate *e, double gap)
{
    return fabs(gap - e->gap) > dmax(ask->resolution, ask->significance * e->std);
}

/* The mean square error of an estimate, and by how much it may grow for no reason but noise, m^2. */
static double margin_of(const GuardSettings *ask, const TwinProblem *problem, const GapEstimate *e, double *mean_square)
{
    Squares sum = squares_at(problem, e->gap, e->theta_d0, e->growth);
    double counted = (double)counted_of(problem);

    *mean_square = sum.gram[0][0] / counted;
    return ask->significance * ask->significance * sum.noise / counted;
}

/* The profile over the whole physical range: costs, then starts; computed once. */
static const double *scan_profile(Guard *G)
{
    if (!G->scanned)
        dtb_profile(&G->problem->data, G->settings->scans, G->settings->scan, G->profile, G->problem->room);
    G->scanned = 1;
    return G->profile;
}

/* The next deepest of the profile's valleys on the grid, after valley `after` (-1: the deepest); -1 for none. A
 * plateau, where no contact is seen any more, is one valley and not many. */
static int64_t next_valley(Guard *G, int64_t after)
{
    const double *cost = scan_profile(G);
    int64_t n = G->settings->scans, found = -1;

    for (int64_t i = 0; i < n; i++) {
        double before = i > 0 ? cost[i - 1] : INFINITY, behind = i + 1 < n ? cost[i + 1] : INFINITY;
        bool valley = cost[i] * (1.0 + PLATEAU) < before && cost[i] <= behind * (1.0 + PLATEAU);
        bool later = after < 0 || cost[i] > cost[after] || (cost[i] == cost[after] && i > after);
        if (valley && later && (found < 0 || cost[i] < cost[found]))
            found = i;
    }
    return found;
}

/* Whether with the same model a gap in another place explains the buffer as well; that gap into attempt->about. */
static bool elsewhere(Guard *G, const Explanation *found, GapAttempt *attempt)
{
    const GuardSettings *ask = G->settings;
    const double *cost = found->doubted ? G->other : scan_profile(G);
    double mean_square, margin = margin_of(ask, &found->problem, &found->estimate, &mean_square);
    int64_t least = -1;

    if (found->doubted)
        dtb_profile(&found->problem.data, ask->scans, ask->scan, G->other, found->problem.room);
    for (int64_t i = 0; i < ask->scans; i++)
        if (far_from(ask, &found->estimate, ask->scan[i]) && (least < 0 || cost[i] < cost[least]))
            least = i;
    if (least < 0 || !(cost[least] <= mean_square + margin))
        return false;
    attempt->about = ask->scan[least];
    return true;
}

/* The same for another gap with another model, sought from the believed model's best gap elsewhere: the reason, or
 * BETTER where there is none. Overwrites the explanation's own output errors. */
static int64_t rival(Guard *G, const Explanation *found, GapAttempt *attempt)
{
    const GuardSettings *ask = G->settings;
    const GapEstimate *e = &found->estimate;
    double mean_square, margin = margin_of(ask, &found->problem, e, &mean_square);
    GapEstimate begun = *e;
    Explanation other;
    int64_t valley = next_valley(G, -1);

    while (valley >= 0 && !(fabs(ask->scan[valley] - e->fit_gap) > ask->resolution))
        valley = next_valley(G, valley);
    if (valley < 0)
        return BETTER;
    begun.gap = ask->scan[valley];
    begun.theta_d0 = G->profile[ask->scans + valley];
    begun.growth = 0.0;
    explain(G->problem, G->wrong, &begun, G->eps_q, &other);
    double gap = attempt->about = other.estimate.gap;
    if (impossible(ask, gap) || fabs(gap - e->gap) <= ask->resolution)
        return BETTER;
    /* beside a clearly better explanation an estimate is no minimum, and its standard error says nothing */
    if (other.cost < found->cost - margin)
        return RIVAL_BETTER;
    return other.cost <= found->cost + margin && far_from(ask, e, gap) ? RIVAL : BETTER;
}

/* The questions in turn; the first that fails is the reason. */
static int64_t reason_of(Guard *G, const Explanation *found, GapAttempt *attempt)
{
    const GuardSettings *ask = G->settings;
    const GapEstimate *e = &found->estimate;

    attempt->about = e->gap;
    if (impossible(ask, e->gap))
        return OUTSIDE;
    if (!e->converged)
        return NOT_CONVERGED;
    if (contact_travel(&found->problem, e) < ask->travel)
        return NO_CONTACT;
    if (!isfinite(e->std))
        return NOT_DETERMINED;
    if (elsewhere(G, found, attempt))
        return ELSEWHERE;
    int64_t other = found->doubted ? rival(G, found, attempt) : BETTER;
    if (other != BETTER)
        return other;
    attempt->about = G->present;
    if (fabs(e->gap - G->present) > ask->significance * e->std)
        return BETTER;
    return e->std <= ask->precise ? AGREES : NO_BETTER;
}

/* An estimate with its standard error, the verdict on it, and what it puts in force: the present gap where the estimate
 * agrees with it, else the estimate less a share of its error, at least 0. Too large a gap does more harm than too
 * small a one. */
static GapAttempt judged(Guard *G, const GapEstimate *e)
{
    const GuardSettings *ask = G->settings;
    GapAttempt attempt = {.estimate = *e, .about = e->gap, .applied = NAN, .reason = OUTSIDE};
    Explanation found;

    if (impossible(ask, e->gap))
        return attempt;
    explain(G->problem, G->wrong, e, G->eps_q, &found);
    attempt.reason = reason_of(G, &found, &attempt);
    attempt.estimate = found.estimate;
    attempt.agrees = attempt.reason == AGREES;
    attempt.settled =
        attempt.reason == NO_BETTER; /* the estimate is the buffer's best: no other start can change that */
    attempt.accepted = attempt.agrees || attempt.reason == BETTER;
    if (!attempt.accepted)
        return attempt;
    double gap = attempt.estimate.gap = within(found.estimate.gap, 0.0, ask->gap_most), std = found.estimate.std;
    double error = dmax(ask->shading * std, ask->agreement);
    bool near = attempt.agrees && fabs(gap - G->present) <= error;
    attempt.applied = near ? G->present : dmax(gap - ask->shading * std, 0.0);
    return attempt;
}

/* Estimate until the guard accepts, at most settings->attempts times, into out (attempts,); returns how often. start
 * (2,), rad: of the first attempt. Where the guard rejects that, further ones begin at the valleys of the profile. */
static int64_t attempt_all(Guard *G, const Optimizer *by, const double *start, GapAttempt *out)
{
    double begin[2] = {start[0], start[1]};
    int64_t valley = -1, n = 0;

    while (true) {
        GapEstimate e = estimate(G->problem, by, begin);
        out[n] = judged(G, &e);
        n++;
        if (out[n - 1].accepted || out[n - 1].settled || n >= G->settings->attempts)
            return n;
        valley = next_valley(G, valley);
        if (valley < 0)
            return n;
        begin[0] = G->settings->scan[valley];
        begin[1] = G->profile[G->settings->scans + valley];
    }
}

/* The attempt (n,) that counts: the accepted one, else the first that explains the buffer best. */
static int64_t outcome_of(int64_t n, const GapAttempt *attempts)
{
    int64_t best = 0;

    for (int64_t i = 1; i < n; i++) {
        const GapAttempt *a = attempts + i, *b = attempts + best;
        int finite_a = isfinite(a->estimate.cost) != 0, finite_b = isfinite(b->estimate.cost) != 0;
        bool better = a->accepted != b->accepted ? a->accepted > b->accepted
                      : finite_a != finite_b     ? finite_a > finite_b
                                                 : a->estimate.cost < b->estimate.cost;
        if (better)
            best = i;
    }
    return best;
}

/* ---- for Python ---- */

/* As attempt_all(). */
int64_t dtb_attempts(Guard *G, const Optimizer *by, const double *start, GapAttempt *out)
{
    return attempt_all(G, by, start, out);
}

/* As judged(). */
void dtb_judge(Guard *G, const GapEstimate *e, GapAttempt *out) { *out = judged(G, e); }

/* The profile's valleys as further starts, the deepest first, into which (scans,); returns how many. */
int64_t dtb_valleys(Guard *G, int64_t *which)
{
    int64_t n = 0;

    for (int64_t valley = next_valley(G, -1); valley >= 0; valley = next_valley(G, valley))
        which[n++] = valley;
    return n;
}

/* The best explanation about an estimate: its cost, m^2, and whether there was anything to explain, into about (2,);
 * the path that explains it, as coefficients b and start (n,) each and d, into path (2 n + 1,), and its eps_q into
 * G->eps_q. */
void dtb_explain(Guard *G, const GapEstimate *e, GapEstimate *out, double *about, double *path)
{
    Explanation found;

    explain(G->problem, G->wrong, e, G->eps_q, &found);
    *out = found.estimate;
    about[0] = found.cost;
    about[1] = found.doubted;
    if (!found.doubted)
        return;
    int64_t n = found.problem.data.path.n;
    copy(found.path_b, path, n);
    copy(found.path_start, path + n, n);
    path[2 * n] = found.problem.data.path.d;
}
