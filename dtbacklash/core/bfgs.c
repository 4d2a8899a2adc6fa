/* A function of two variables minimised by BFGS, with the line search of More and Thuente (ACM TOMS 20, 1994). */
#include "core.h"

/* sufficient decrease and curvature (Nocedal and Wright, Numerical Optimization, 2006, chapters 3 and 6); trials of a
 * step; iterations */
static const double DECREASE = 1e-4, CURVATURE = 0.9, NARROW = 1e-14, STEP_MOST = 1e100, STEP_LEAST = 1e-100;
enum { TRIALS = 100, ITERATIONS = 400 };

/* What is minimised: the cost of a buffer, in variables and units of order one: see scaled_cost(). */
typedef struct {
    const TwinProblem *problem;
    int64_t spent, most;
    double best, best_x[2];
} Search;

/* A point on a line: how far along it, the value there, and its slope. */
typedef struct {
    double at, value, slope;
} Trial;

/* The interval of a line search: its best end and the other one, and what else it remembers. */
typedef struct {
    Trial best, end;
    bool bracketed, sloped; /* whether a minimum lies inside; whether a point was low enough, with a slope upwards */
    double low, high, width, width_before;
} Interval;

static double scaled_cost(const TwinProblem *problem, const double *x, double *g);

/* Cost into value and gradient into g (2,) at x (2,); false where the evaluations are spent. */
static bool evaluate(Search *s, const double *x, double *value, double *g)
{
    if (s->spent >= s->most)
        return false;
    s->spent++;
    *value = scaled_cost(s->problem, x, g);
    if (*value < s->best) {
        s->best = *value;
        copy(x, s->best_x, 2);
    }
    return true;
}

/* Where the cubic through two points has its minimum, as a share of the way from the one to the other. turn : 0 where
 * it has none. */
static double cubic_minimum(Trial from, Trial to, double *turn)
{
    double theta = 3.0 * (from.value - to.value) / (to.at - from.at) + from.slope + to.slope;
    double scale = dmax(fabs(theta), dmax(fabs(from.slope), fabs(to.slope)));
    double square = (theta / scale) * (theta / scale) - (from.slope / scale) * (to.slope / scale);

    *turn = (to.at > from.at ? scale : -scale) * sqrt(dmax(square, 0.0));
    return (*turn - from.slope + theta) / (2.0 * *turn - from.slope + to.slope);
}

/* The step after a trial that is lower than the best one, whose slope has the same sign and is smaller. */
static double extrapolated(const Interval *I, Trial now)
{
    Trial best = I->best;
    double turn, share = cubic_minimum(now, best, &turn), away = now.at > best.at ? I->high : I->low;
    double cubic = share < 0.0 && turn != 0.0 ? now.at + share * (best.at - now.at) : away;
    double secant = now.at + now.slope / (now.slope - best.slope) * (best.at - now.at);
    bool nearer = fabs(cubic - now.at) < fabs(secant - now.at);

    if (!I->bracketed)
        return dmin(dmax(nearer ? secant : cubic, I->low), I->high);
    double found = nearer ? cubic : secant, most = now.at + 0.66 * (I->end.at - now.at);
    return now.at > best.at ? dmin(most, found) : dmax(most, found);
}

/* The next step of a line search after a trial, which becomes an end of the interval. */
static double next_step(Interval *I, Trial now)
{
    Trial best = I->best;
    bool turned = now.slope * (best.slope > 0.0 ? 1.0 : best.slope < 0.0 ? -1.0 : 0.0) < 0.0;
    double turn, to_best = best.at - now.at, next;

    if (now.value > best.value) {
        double cubic = best.at - cubic_minimum(best, now, &turn) * to_best;
        double fall = (best.value - now.value) / -to_best + best.slope;
        double quadratic = best.at - best.slope / fall / 2.0 * to_best;
        next = fabs(cubic - best.at) < fabs(quadratic - best.at) ? cubic : cubic + (quadratic - cubic) / 2.0;
    } else if (turned) {
        double cubic = now.at + cubic_minimum(now, best, &turn) * to_best;
        double secant = now.at + now.slope / (now.slope - best.slope) * to_best;
        next = fabs(cubic - now.at) > fabs(secant - now.at) ? cubic : secant;
    } else if (fabs(now.slope) < fabs(best.slope)) {
        next = extrapolated(I, now);
    } else if (I->bracketed) {
        next = now.at + cubic_minimum(now, I->end, &turn) * (I->end.at - now.at);
    } else {
        next = now.at > best.at ? I->high : I->low;
    }
    I->bracketed = I->bracketed || now.value > best.value || turned;
    if (now.value > best.value) {
        I->end = now;
    } else {
        if (turned)
            I->end = best;
        I->best = now;
    }
    return next;
}

/* A point as the function less its sufficient decrease has it, or back with the sign -1. */
static Trial less(Trial from, double fall, double sign)
{
    return (Trial){from.at, from.value - sign * from.at * fall, from.slope - sign * fall};
}

/* The next step after a trial that does not do, within the bounds of the interval, which shrinks. */
static double refined_step(Interval *I, Trial now, double level, double fall)
{
    double step;

    if (!I->sloped && now.value <= I->best.value && now.value > level) {
        I->best = less(I->best, fall, 1.0), I->end = less(I->end, fall, 1.0);
        step = next_step(I, less(now, fall, 1.0));
        I->best = less(I->best, fall, -1.0), I->end = less(I->end, fall, -1.0);
    } else {
        step = next_step(I, now);
    }
    double best = I->best.at, end = I->end.at;
    if (I->bracketed) {
        if (fabs(end - best) >= 0.66 * I->width_before)
            step = best + 0.5 * (end - best);
        I->width_before = I->width;
        I->width = fabs(end - best);
        I->low = dmin(best, end);
        I->high = dmax(best, end);
    } else {
        I->low = step + 1.1 * (step - best);
        I->high = step + 4.0 * (step - best);
    }
    step = dmin(dmax(step, STEP_LEAST), STEP_MOST);
    if (I->bracketed && (step <= I->low || step >= I->high || I->high - I->low <= NARROW * I->high))
        step = best;
    return step;
}

/* A step along p (2,) from x (2,) that satisfies the strong Wolfe conditions, into trial, with the gradient there in
 * g (2,); ENDED, or SPENT, or STUCK where none is found. first : value and slope at x, and the step to try. */
static int line_search(Search *s, const double *x, const double *p, Trial first, Trial *trial, double *g)
{
    Trial start = {0.0, first.value, first.slope};
    Interval I = {start, start, false, false, 0.0, 5.0 * first.at, STEP_MOST, 2.0 * STEP_MOST};
    double fall = DECREASE * start.slope;

    trial->at = first.at;
    for (int i = 0; i < TRIALS; i++) {
        const double at[2] = {x[0] + trial->at * p[0], x[1] + trial->at * p[1]};
        if (!evaluate(s, at, &trial->value, g))
            return SPENT;
        trial->slope = g[0] * p[0] + g[1] * p[1];
        double level = start.value + trial->at * fall;
        if (trial->value <= level && fabs(trial->slope) <= -CURVATURE * start.slope)
            return ENDED;
        if (trial->value <= level && trial->slope >= 0.0)
            I.sloped = true;
        bool narrow = trial->at <= I.low || trial->at >= I.high || I.high - I.low <= NARROW * I.high;
        if ((I.bracketed && narrow) || !isfinite(trial->value))
            return STUCK;
        trial->at = refined_step(&I, *trial, level, fall);
    }
    return STUCK;
}

/* The inverse of the Hessian, h (2, 2), after a step s that changed the gradient by y. */
static void update_inverse(double h[2][2], const double *s, const double *y)
{
    double along = y[0] * s[0] + y[1] * s[1], rho = along == 0.0 ? 1000.0 : 1.0 / along;
    double left[2][2], a[2][2];

    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++)
            a[i][j] = (i == j ? 1.0 : 0.0) - rho * s[i] * y[j];
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++)
            left[i][j] = a[i][0] * h[0][j] + a[i][1] * h[1][j];
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++)
            h[i][j] = left[i][0] * a[j][0] + left[i][1] * a[j][1] + rho * s[i] * s[j];
}

/* Minimise from x (2,) until no element of the gradient is above a tolerance; how it ended. */
static int bfgs(Search *s, double *x, double tolerance)
{
    double value, g[2], h[2][2] = {{1.0, 0.0}, {0.0, 1.0}};

    if (!evaluate(s, x, &value, g))
        return SPENT;
    double before = value + 0.5 * sqrt(g[0] * g[0] + g[1] * g[1]);
    for (int i = 0; i < ITERATIONS && !(dmax(fabs(g[0]), fabs(g[1])) <= tolerance); i++) {
        const double p[2] = {-(h[0][0] * g[0] + h[0][1] * g[1]), -(h[1][0] * g[0] + h[1][1] * g[1])};
        double slope = g[0] * p[0] + g[1] * p[1], first = dmin(1.0, 2.02 * (value - before) / slope), next[2];
        Trial trial;
        int end = line_search(s, x, p, (Trial){first > 0.0 ? first : 1.0, value, slope}, &trial, next);
        if (end != ENDED)
            return end;
        const double moved[2] = {trial.at * p[0], trial.at * p[1]}, turned[2] = {next[0] - g[0], next[1] - g[1]};
        before = value;
        value = trial.value;
        x[0] += moved[0], x[1] += moved[1];
        copy(next, g, 2);
        update_inverse(h, moved, turned);
    }
    return dmax(fabs(g[0]), fabs(g[1])) <= tolerance ? ENDED : STUCK;
}
