/* The twin's output error in a buffer: the play, the structure's observer behind it, and the best start of the screw.
 *
 * `room` is memory to work in: the states of as many paths as a function has, n doubles each. */
#include "core.h"

/* how the best start for a gap is sought: first tries across the gap; steps of Newton's method that follow, each halved
 * until it helps, for as long as one gains this share of the cost */
enum { COARSE_STARTS = 9, POLISH_STEPS = 6, HALVINGS = 4 };
static const double LEAST_GAIN = 1e-9;

/* theta_d, and its derivatives by the half-gap, by where it rested, and by the growth of the gap */
enum { THETA_D, BY_GAP, BY_START, BY_GROWTH, N_ROWS };

/* What is believed of the play: half-gap in the middle of the buffer, rad; where theta_d rests before the first sample,
 * rad; by how much the half-gap grows, rad/sample. */
typedef struct {
    double half_gap, theta_d0, growth;
} Believed;

/* Sums over the counted samples, of the output error and its derivatives by the half-gap and by theta_d0. */
typedef struct {
    double error_error, error_gap, error_start, start_start;
} Moments;

/* A start theta_d0, rad, and its cost, m^2. */
typedef struct {
    double cost, start;
} Valley;

/* A function with the number of lags of a usual structure written out, so that its loops are unrolled, or of any. */
#define WITH_LAGS(function, n, ...)                                                                                    \
    ((n) == 2   ? function(2, __VA_ARGS__)                                                                             \
     : (n) == 4 ? function(4, __VA_ARGS__)                                                                             \
     : (n) == 6 ? function(6, __VA_ARGS__)                                                                             \
     : (n) == 8 ? function(8, __VA_ARGS__)                                                                             \
                : function(n, __VA_ARGS__))

/* ---- a path ---- */

/* Set the state x (n,) of a path to rest at the input u. */
UNROLLED void rest_n(int64_t n, const TwinPath *path, double *restrict x, double u)
{
    for (int64_t i = 0; i < n; i++)
        x[i] = path->start[i] * u;
}

/* The output of a path in the state x (n,), with the input u. */
static inline double path_output(const TwinPath *path, const double *x, double u) { return x[0] + path->d * u; }

/* The state x (n,) of a path goes on by one sample with the input u. */
UNROLLED void go_on_n(int64_t n, const TwinPath *path, double *restrict x, double u)
{
    for (int64_t i = 0; i < n; i++) {
        double next = path->b[i] * u;
        for (int64_t j = i; j < n; j++)
            next += path->phi[i * n + j] * x[j];
        x[i] = next;
    }
}

/* As dtb_filter, with n lags. */
UNROLLED void filter_n(int64_t n, const TwinPath *path, int64_t N, double *restrict u, double *restrict x)
{
    for (int64_t k = 0; k < N; k++) {
        double now = u[k];
        if (k == 0)
            rest_n(n, path, x, now);
        u[k] = path_output(path, x, now);
        go_on_n(n, path, x, now);
    }
}

/* Samples u (N,) become the response of a path to them, from rest at u[0]; room of one path. */
void dtb_filter(const TwinPath *path, int64_t N, double *u, double *room)
{
    WITH_LAGS(filter_n, path->n, path, N, u, room);
}

/* ---- the play ---- */

/* How far sample k of N lies after the middle of the buffer, samples. */
static inline double after_middle(int64_t k, int64_t N) { return (double)k - 0.5 * (double)(N - 1); }

/* The half-gap so many samples after the middle, rad; that in the middle counts by its size. */
static inline double gap_at(Believed by, double after) { return dmax(fabs(by.half_gap) + by.growth * after, 0.0); }

/* theta_d of the play behind theta_m, both (N,), rad: from theta_d0 on, for a half-gap in the middle of the buffer that
 * grows, rad and rad/sample. */
void dtb_play(int64_t N, const double *theta_m, double half_gap, double theta_d0, double growth, double *theta_d)
{
    double now = theta_d0;

    for (int64_t k = 0; k < N; k++)
        now = theta_d[k] = play(now, theta_m[k], dmax(half_gap + growth * after_middle(k, N), 0.0));
}

/* The rows `at` of the play before its first sample. */
static inline void set_rows(Believed by, double *at)
{
    set_zero(at, N_ROWS);
    at[THETA_D] = by.theta_d0;
    at[BY_START] = 1.0;
}

/* The rows `at` of the play go on to theta_m, rad, which lies so many samples after the middle. The derivatives are
 * exact wherever the play is smooth: they are those of the side that pushed last. */
static inline void push(Believed by, double theta_m, double after, double *at)
{
    double gap = gap_at(by, after), side = 0.0;

    if (at[THETA_D] < theta_m - gap)
        side = -1.0;
    else if (at[THETA_D] > theta_m + gap)
        side = 1.0;
    if (side == 0.0)
        return;
    at[THETA_D] = theta_m + side * gap;
    at[BY_GAP] = by.half_gap < 0.0 ? -side : side;
    at[BY_START] = 0.0;
    at[BY_GROWTH] = side * after;
}

/* ---- the output error ---- */

/* As dtb_cost, with n lags. */
UNROLLED double cost_n(int64_t n, const TwinBuffer *in, Believed by, double *restrict x)
{
    int64_t N = in->samples;
    double theta_d = by.theta_d0, total = 0.0;

    for (int64_t k = 0; k < N; k++) {
        theta_d = play(theta_d, in->theta_m[k], gap_at(by, after_middle(k, N)));
        if (k == 0)
            rest_n(n, &in->path, x, theta_d);
        if (k >= in->settle) {
            double error = in->eps_q[k] + x[0] + in->path.d * theta_d;
            total += error * error;
        }
        go_on_n(n, &in->path, x, theta_d);
    }
    return total / (double)(N - in->settle);
}

static double cost(const TwinBuffer *in, Believed by, double *room)
{
    return WITH_LAGS(cost_n, in->path.n, in, by, room);
}

/* Mean square output error of the counted samples, m^2; room of one path. */
double dtb_cost(const TwinBuffer *in, double half_gap, double theta_d0, double growth, double *room)
{
    return cost(in, (Believed){half_gap, theta_d0, growth}, room);
}

/* As dtb_sensitivities, with n lags. */
UNROLLED void sensitivities_n(int64_t n, const TwinBuffer *in, Believed by, double *restrict E, double *restrict x)
{
    int64_t N = in->samples, counted = N - in->settle;
    double at[N_ROWS];

    set_rows(by, at);
    for (int64_t k = 0; k < N; k++) {
        push(by, in->theta_m[k], after_middle(k, N), at);
        for (int64_t r = 0; r < N_ROWS; r++) {
            if (k == 0)
                rest_n(n, &in->path, x + r * n, at[r]);
            if (k >= in->settle)
                E[r * counted + k - in->settle] = path_output(&in->path, x + r * n, at[r]);
            go_on_n(n, &in->path, x + r * n, at[r]);
        }
        if (k >= in->settle)
            E[k - in->settle] += in->eps_q[k];
    }
}

/* Output error of the counted samples, m, and its derivatives by half_gap, theta_d0 and growth, SI, into the rows of
 * E (4, samples - settle); room of four paths. */
void dtb_sensitivities(const TwinBuffer *in, double half_gap, double theta_d0, double growth, double *E, double *room)
{
    Believed by = {half_gap, theta_d0, growth};
    WITH_LAGS(sensitivities_n, in->path.n, in, by, E, room);
}

/* Sums of the output error and two derivatives of it, with n lags; x (3 n,). */
UNROLLED Moments moments_n(int64_t n, const TwinBuffer *in, Believed by, double *restrict x)
{
    const TwinPath *path = &in->path;
    double at[N_ROWS];
    Moments sum = {0.0, 0.0, 0.0, 0.0};

    set_rows(by, at);
    for (int64_t k = 0; k < in->samples; k++) {
        push(by, in->theta_m[k], after_middle(k, in->samples), at);
        for (int64_t r = THETA_D; k == 0 && r <= BY_START; r++)
            rest_n(n, path, x + r * n, at[r]);
        if (k >= in->settle) {
            double error = path_output(path, x, at[THETA_D]) + in->eps_q[k];
            double by_gap = path_output(path, x + BY_GAP * n, at[BY_GAP]);
            double by_start = path_output(path, x + BY_START * n, at[BY_START]);
            sum.error_error += error * error;
            sum.error_gap += error * by_gap;
            sum.error_start += error * by_start;
            sum.start_start += by_start * by_start;
        }
        for (int64_t r = THETA_D; r <= BY_START; r++)
            go_on_n(n, path, x + r * n, at[r]);
    }
    return sum;
}

static Moments moments(const TwinBuffer *in, Believed by, double *room)
{
    return WITH_LAGS(moments_n, in->path.n, in, by, room);
}

/* Cost, m^2, and its derivatives by half_gap and theta_d0, m^2/rad, into out (3,), without growth; room of three
 * paths. */
void dtb_cost_and_gradient(const TwinBuffer *in, double half_gap, double theta_d0, double *out, double *room)
{
    Moments sum = moments(in, (Believed){half_gap, theta_d0, 0.0}, room);
    double scale = 2.0 / (double)(in->samples - in->settle);

    out[0] = 0.5 * scale * sum.error_error;
    out[1] = scale * sum.error_gap;
    out[2] = scale * sum.error_start;
}

/* ---- the best start for a gap ---- */

/* The best of a few starts across the gap. */
static Valley best_of_few(const TwinBuffer *in, double half_gap, double *room)
{
    Valley best = {INFINITY, in->theta_m[0]};

    for (int64_t i = 0; i < COARSE_STARTS; i++) {
        double start = in->theta_m[0] + half_gap * (2.0 * (double)i / (COARSE_STARTS - 1) - 1.0);
        double value = cost(in, (Believed){half_gap, start, 0.0}, room);
        if (value < best.cost)
            best = (Valley){value, start};
    }
    return best;
}

/* Go from a start by a step, rad, which is halved until it helps, within the gap; by how much it lowered the cost, m^2.
 */
static double descend(const TwinBuffer *in, double half_gap, double step, Valley *best, double *room)
{
    for (int64_t i = 0; i < HALVINGS; i++, step *= 0.5) {
        double start = dmin(dmax(best->start + step, in->theta_m[0] - half_gap), in->theta_m[0] + half_gap);
        double value = cost(in, (Believed){half_gap, start, 0.0}, room), gained = best->cost - value;
        if (value < best->cost) {
            *best = (Valley){value, start};
            return gained;
        }
    }
    return 0.0;
}

/* Least cost over theta_d0 for one gap: where it matters the cost is piecewise quadratic in it, so that Newton's method
 * from the best of a few starts ends at rounding. */
static Valley profile_point(const TwinBuffer *in, double half_gap, double *room)
{
    Valley best = best_of_few(in, half_gap, room);

    for (int64_t i = 0; i < POLISH_STEPS; i++) {
        Moments sum = moments(in, (Believed){half_gap, best.start, 0.0}, room);
        if (sum.start_start <= 0.0)
            break;
        double gained = descend(in, half_gap, -sum.error_start / sum.start_start, &best, room);
        if (gained <= LEAST_GAIN * best.cost)
            break;
    }
    return best;
}

/* For each of some half-gaps, rad, the least cost over theta_d0, m^2, and that theta_d0, rad, into the rows of
 * out (2, count); room of three paths. */
void dtb_profile(const TwinBuffer *in, int64_t count, const double *half_gaps, double *out, double *room)
{
    for (int64_t i = 0; i < count; i++) {
        Valley best = profile_point(in, half_gaps[i], room);
        out[i] = best.cost;
        out[count + i] = best.start;
    }
}

/* ---- the simulated twin ---- */

/* What a sensor shows at each of N samples, into out (N,), of a plant that is led by theta_m (N,), rad, behind a
 * half-gap (N,), rad, whose own change does not push the screw before the motor does; y (sensors,) : room. */
void dtb_follow(const Plant *P, State *S, int64_t N, const double *theta_m, const double *gap, int64_t sensor,
                double *y, double *out)
{
    for (int64_t k = 0; k < N; k++) {
        sense(P, S, (Gap){gap[k], 0.0}, y);
        out[k] = y[sensor];
        if (k + 1 < N)
            advance(P, S, (double)k * P->sample_time, 0.0, gap[k], gap[k + 1], (Imposed){theta_m, N, k});
    }
}
