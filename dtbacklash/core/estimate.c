/* The gap from one buffer: eq. (18) minimised, the growth of the gap, and their standard errors. */
#include "core.h"

#define DEGREE 0.017453292519943295 /* rad */
/* a point counts as stationary when the Gauss-Newton step from it moves the gap by less, rad */
#define STATIONARY (0.05 * DEGREE)
/* a cost below what this angle of theta_d does to the structure at rest is rounding and interpolation */
#define FLOOR_ANGLE (0.05 * DEGREE)
/* growth is used only if it explains this many times the noise, and moves the estimate by no more than this, rad */
#define GROWTH_SIGNIFICANCE 25.0
#define GROWTH_SHIFT_MOST DEGREE
/* a parameter is seen by the data from this information on, in samples and squares of the pitch */
#define LEAST_SEEN 1e-6
/* masses of a structure, and parameters of a fit with what may be wrong in it: psi, gap, start and growth */
#ifndef MASSES_MOST
#define MASSES_MOST 8
#endif
#define LAGS_MOST (2 * MASSES_MOST)
#define FIT_MOST (8 + MASSES_MOST)

/* Sums over the counted samples of products of the output error and its derivatives by gap, start and growth [rad/s],
 * by rows; noise : see noise_of(), m^2. */
typedef struct {
    double gram[N_ROWS][N_ROWS], noise;
} Squares;

/* Means of the output error over blocks, which end with the buffer. */
typedef struct {
    int64_t length, count, skip;
    double sum, squares;
} Blocks;

/* ---- linear algebra of a few parameters ---- */

/* Turn rows and columns p, q of a symmetric A (n, n), by rows of `stride`, so that A[p][q] is 0, and columns of V. */
static void rotate(int64_t n, int64_t stride, double *A, double *V, int64_t p, int64_t q)
{
    double off = A[p * stride + q];

    if (off == 0.0)
        return;
    double ratio = (A[q * stride + q] - A[p * stride + p]) / (2.0 * off);
    double t = (ratio < 0.0 ? -1.0 : 1.0) / (fabs(ratio) + sqrt(ratio * ratio + 1.0));
    double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
    for (int64_t k = 0; k < n; k++) {
        double kp = A[k * stride + p], kq = A[k * stride + q];
        A[k * stride + p] = c * kp - s * kq;
        A[k * stride + q] = s * kp + c * kq;
    }
    for (int64_t k = 0; k < n; k++) {
        double pk = A[p * stride + k], qk = A[q * stride + k], vp = V[k * stride + p], vq = V[k * stride + q];
        A[p * stride + k] = c * pk - s * qk;
        A[q * stride + k] = s * pk + c * qk;
        V[k * stride + p] = c * vp - s * vq;
        V[k * stride + q] = s * vp + c * vq;
    }
}

/* The pseudo-inverse of a symmetric A (n, n), by rows of `stride`, in its place: eigenvalues below `least` times the
 * largest count as 0. Jacobi's method (Golub and Van Loan, Matrix Computations, 2013, 8.5). */
static void pseudo_invert(int64_t n, int64_t stride, double *A, double least)
{
    enum { SWEEPS = 12 };
    double V[FIT_MOST * FIT_MOST] = {0.0}, values[FIT_MOST], largest = 0.0;

    for (int64_t i = 0; i < n; i++)
        V[i * stride + i] = 1.0;
    for (int sweep = 0; sweep < SWEEPS; sweep++)
        for (int64_t p = 0; p < n; p++)
            for (int64_t q = p + 1; q < n; q++)
                rotate(n, stride, A, V, p, q);
    for (int64_t i = 0; i < n; i++) {
        values[i] = A[i * stride + i];
        largest = dmax(largest, fabs(values[i]));
    }
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < n; j++) {
            double sum = 0.0;
            for (int64_t k = 0; k < n; k++)
                if (fabs(values[k]) > least * largest)
                    sum += V[i * stride + k] * V[j * stride + k] / values[k];
            A[i * stride + j] = sum;
        }
}

/* ---- noise ---- */

/* Blocks of half the observer's memory, of so many samples. */
static Blocks blocks_of(const TwinModel *model, int64_t counted)
{
    int64_t memory = (int64_t)nearbyint(2.0 / (model->pole * model->sample_time));
    int64_t most = least_of(memory, counted / 4), length = most > 1 ? most : 1;

    return (Blocks){length, counted / length, counted % length, 0.0, 0.0};
}

/* Take in the error of counted sample i. */
static inline void add_to_blocks(Blocks *b, int64_t i, double error)
{
    if (i < b->skip)
        return;
    b->sum += error;
    if ((i - b->skip + 1) % b->length == 0) {
        b->squares += b->sum / (double)b->length * (b->sum / (double)b->length);
        b->sum = 0.0;
    }
}

/* What a cost at which only rounding is left is below, m^2. */
static double floor_of(const TwinModel *model)
{
    double moved = model->pitch * FLOOR_ANGLE;
    return moved * moved;
}

/* Noise of the cost: the variance that one independent sample of the error would have, m^2.
 *
 * The sensitivities to the parameters vary slowly, so what counts is the error's power at low frequency. The largest
 * of: the power that white noise of a sensor would have there after the observer; the power measured there, by means
 * over blocks; and rounding. */
static double noise_of(const TwinModel *model, const Blocks *b, double mean_square)
{
    double length = (double)b->length, white = dmin(model->noise_colour, length) * mean_square;
    return dmax(length * (b->squares / (double)b->count), dmax(white, floor_of(model)));
}

/* The noise of an output error (counted,), m^2. */
double dtb_noise(const TwinModel *model, int64_t counted, const double *error)
{
    Blocks blocks = blocks_of(model, counted);
    double total = 0.0;

    for (int64_t i = 0; i < counted; i++) {
        add_to_blocks(&blocks, i, error[i]);
        total += error[i] * error[i];
    }
    return noise_of(model, &blocks, total / (double)counted);
}

/* ---- the cost ---- */

static inline int64_t counted_of(const TwinProblem *problem) { return problem->data.samples - problem->data.settle; }

/* Cost and gradient into g (2,) at x = (half-gap, theta_d0 - theta_m0), deg, in units of the square of what 1 deg of
 * theta_d does to the structure at rest: of order one for every rig, so that a tolerance means the same. */
static double scaled_cost(const TwinProblem *problem, const double *x, double *g)
{
    double out[3], unit = problem->model->pitch * DEGREE, scale = 1.0 / (unit * unit);
    double gap = x[0] * DEGREE, start = problem->data.theta_m[0] + x[1] * DEGREE;

    if (problem->cost)
        problem->cost(problem->simulation, gap, start, out);
    else
        dtb_cost_and_gradient(&problem->data, gap, start, out, problem->room);
    for (int i = 0; i < 2; i++)
        g[i] = out[i + 1] * (scale * DEGREE);
    return out[0] * scale;
}

/* Output error and its derivatives into row, at sample k: what the path makes of the rows `at` of the play; its states
 * x (4 n,) go on. */
static void error_row(const TwinBuffer *in, int64_t k, const double *at, double *x, double *row)
{
    int64_t n = in->path.n;

    for (int64_t r = 0; r < N_ROWS; r++) {
        if (k == 0)
            rest_n(n, &in->path, x + r * n, at[r]);
        row[r] = path_output(&in->path, x + r * n, at[r]);
        go_on_n(n, &in->path, x + r * n, at[r]);
    }
    row[THETA_D] += in->eps_q[k];
}

/* Sums at a half-gap, rad, a start, rad, and a growth, rad/s. */
static Squares squares_at(const TwinProblem *problem, double gap, double start, double growth)
{
    const TwinModel *model = problem->model;
    const TwinBuffer *in = &problem->data;
    Believed by = {gap, start, growth * model->sample_time};
    Blocks blocks = blocks_of(model, counted_of(problem));
    Squares sum = {.noise = 0.0};
    double at[N_ROWS], row[N_ROWS], *x = problem->room;

    if (problem->rows)
        problem->rows(problem->simulation, gap, start, growth, problem->simulated);
    set_rows(by, at);
    for (int64_t k = problem->rows ? in->settle : 0; k < in->samples; k++) {
        if (problem->rows) {
            for (int64_t r = 0; r < N_ROWS; r++)
                row[r] = problem->simulated[r * counted_of(problem) + k - in->settle];
        } else {
            push(by, in->theta_m[k], after_middle(k, in->samples), at);
            error_row(in, k, at, x, row);
            row[BY_GROWTH] *= model->sample_time;
        }
        if (k < in->settle)
            continue;
        add_to_blocks(&blocks, k - in->settle, row[THETA_D]);
        for (int r = 0; r < N_ROWS; r++)
            for (int s = r; s < N_ROWS; s++)
                sum.gram[r][s] += row[r] * row[s];
    }
    for (int r = 0; r < N_ROWS; r++)
        for (int s = 0; s < r; s++)
            sum.gram[r][s] = sum.gram[s][r];
    sum.noise = noise_of(model, &blocks, sum.gram[0][0] / (double)counted_of(problem));
    return sum;
}

/* Gauss-Newton step (n,) of gap, start and, with n = 3, growth; and its variances (n,) per noise.
 *
 * A parameter that the data do not see at all (theta_d0 after an early contact) stays: step 0, variance inf. */
static void newton_step(const TwinProblem *problem, const Squares *sum, int n, double *step, double *variances)
{
    double A[3 * 3], least = LEAST_SEEN * (double)counted_of(problem) * problem->model->pitch * problem->model->pitch;
    bool seen[3];

    for (int i = 0; i < n; i++)
        seen[i] = sum->gram[i + 1][i + 1] > least;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            A[i * 3 + j] = seen[i] && seen[j] ? sum->gram[i + 1][j + 1] : 0.0;
    pseudo_invert(n, 3, A, 1e-9);
    for (int i = 0; i < n; i++) {
        step[i] = 0.0;
        for (int j = 0; j < n; j++)
            step[i] -= A[i * 3 + j] * sum->gram[j + 1][0];
        variances[i] = seen[i] ? A[i * 3 + i] : INFINITY;
    }
}

/* Growth of the gap within the buffer, its standard error, and the shift of the estimate to the buffer's middle.
 *
 * Eq. (18) takes the gap as constant and so finds the gap of the samples it weighs most, which lie after the middle:
 * where the gap grows it would be biased. One more parameter, fitted by two linear steps, takes the bias out. Where the
 * data do not show growth clearly the estimate stays the paper's. */
static void find_growth(const TwinProblem *problem, const Squares *plain, GapEstimate *out)
{
    double x[3] = {out->fit_gap, out->theta_d0, 0.0}, step[3], variances[3];
    Squares sum = *plain;

    for (int i = 0; i < 2; i++) {
        newton_step(problem, &sum, 3, step, variances);
        for (int j = 0; j < 3; j++)
            x[j] += step[j];
        if (x[0] < 0.0)
            return;
        sum = squares_at(problem, x[0], x[1], x[2]);
    }
    double gain = plain->gram[0][0] - sum.gram[0][0], shift = x[0] - out->fit_gap;
    if (!(gain > GROWTH_SIGNIFICANCE * sum.noise) || fabs(shift) > GROWTH_SHIFT_MOST)
        return;
    newton_step(problem, &sum, 3, step, variances);
    out->growth = x[2];
    out->growth_std = sqrt(variances[2] * sum.noise);
    out->gap = dmax(out->fit_gap + shift, 0.0);
}

/* A start of the search: half-gap and theta_d0, rad, from the half-gap in force.
 *
 * Before a buffer starts the structure is at rest, so theta_d0 shows in q3 itself; and the gap is at least the distance
 * from there to theta_m. */
static void default_start(const TwinProblem *problem, double present, double *start)
{
    start[1] = problem->q3[0] / problem->model->pitch;
    start[0] = dmax(present, fabs(problem->data.theta_m[0] - start[1]));
}

/* Minimise eq. (18) from a start (2,): half-gap and theta_d0, rad. A search that spends its evaluations returns its
 * best point, not converged. */
static GapEstimate estimate(const TwinProblem *problem, const Optimizer *by, const double *start)
{
    double theta_m = problem->data.theta_m[0], step[2], variances[2];
    double x[2] = {start[0] * (1.0 / DEGREE), (start[1] - theta_m) * (1.0 / DEGREE)};
    Search search = {problem, 0, by->most, INFINITY, {0.0, 0.0}};
    int64_t done[2] = {0, 0};
    GapEstimate out;

    if (by->other) {
        by->other(by->method, x, done);
        out.end = OTHERWISE;
    } else {
        out.end = bfgs(&search, x, by->tolerance);
        copy(search.best_x, x, 2);
        done[0] = search.spent;
        done[1] = out.end == ENDED;
    }
    out.fit_gap = fabs(x[0]) * DEGREE;
    out.theta_d0 = theta_m + x[1] * DEGREE;
    Squares sum = squares_at(problem, out.fit_gap, out.theta_d0, 0.0);
    newton_step(problem, &sum, 2, step, variances);
    /* a gap cannot shrink below zero: there a step downwards is no step, and the cost may have a corner */
    bool stationary = isfinite(variances[0]) && fabs(dmax(step[0], -out.fit_gap)) < STATIONARY;
    out.gap = out.fit_gap;
    out.cost = sum.gram[0][0] / (double)counted_of(problem);
    out.std = sqrt(variances[0] * sum.noise);
    out.growth = 0.0;
    out.growth_std = INFINITY;
    out.evaluations = done[0];
    out.converged = done[1] || stationary;
    find_growth(problem, &sum, &out);
    return out;
}

/* ---- for Python ---- */

/* As estimate(). */
void dtb_estimate(const TwinProblem *problem, const Optimizer *by, const double *start, GapEstimate *out)
{
    *out = estimate(problem, by, start);
}

/* As default_start(). */
void dtb_default_start(const TwinProblem *problem, double present, double *start)
{
    default_start(problem, present, start);
}

/* The masses that a structure may have. */
int64_t dtb_masses_most(void) { return MASSES_MOST; }
