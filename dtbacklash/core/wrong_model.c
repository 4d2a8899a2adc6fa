/* What a wrong model does to an estimate: the gap, fitted again with what may be wrong: twin/gap/model_error.py. */
#include "core.h"

/* Gauss-Newton steps, each halved so often until it helps; a step of the gap in its standard errors after which there
 * is no further one; one that is left at most */
enum { FIT_STEPS = 12, FIT_HALVINGS = 4 };
static const double FITTED = 0.01, FIT_STATIONARY = 0.5;

/* the four things that the output error is a sum of: the lags of three signals, and a constant */
enum { OF_Q3, OF_THETA_D, OF_FRICTION, OF_CONSTANT, N_OF };

/* entries of psi that the terms know by themselves */
enum { STIFFNESS, DAMPING, PITCH };

/* Coefficients v of the output error. */
typedef struct {
    double of[N_OF][LAGS_MOST + 1];
} Coefficients;

/* Sums over the counted samples at a point of the fit: of the error's square, of its products with its derivatives, and
 * of the products of these, (n, n) by rows of FIT_MOST. */
typedef struct {
    double error_error, noise, error_by[FIT_MOST], information[FIT_MOST * FIT_MOST];
} FitSquares;

/* A buffer explained: by another path and other output errors (doubted), or as it came. cost : mean square error and
 * what the deviations from the believed model cost beside it, m^2. */
typedef struct {
    TwinProblem problem;
    GapEstimate estimate;
    double cost;
    bool doubted;
    double path_b[LAGS_MOST], path_start[LAGS_MOST];
} Explanation;

static int64_t fit_size(const ModelError *wrong) { return 8 + wrong->masses; }

/* ---- the believed model ---- */

/* Gap, start and growth x (3,) where Gauss-Newton ends; the sums there, and the variances (3,) per noise. */
static Squares descend_all(const TwinProblem *problem, double *x, double *variances)
{
    Squares sum = squares_at(problem, x[0], x[1], x[2]), trial = sum;
    double step[3];

    newton_step(problem, &sum, 3, step, variances);
    for (int i = 0; i < FIT_STEPS; i++) {
        double moved[3];
        bool helped = false;
        for (int j = 0; j < FIT_HALVINGS && !helped; j++) {
            moved[0] = dmax(x[0] + step[0], 0.0);
            moved[1] = x[1] + step[1];
            moved[2] = x[2] + step[2];
            trial = squares_at(problem, moved[0], moved[1], moved[2]);
            helped = trial.gram[0][0] < sum.gram[0][0];
            for (int r = 0; r < 3; r++)
                step[r] *= 0.5;
        }
        if (!helped)
            break;
        copy(moved, x, 3);
        sum = trial;
        newton_step(problem, &sum, 3, step, variances);
    }
    return sum;
}

/* The estimate with gap, start and growth fitted to the end, where that leaves no more than rounding; else as it came.
 * Returns whether it does.
 *
 * The plain estimate has taken two linear steps towards the growth, and may have the screw rest on the wrong side of
 * the gap: the fit also begins where the structure at rest says that the screw is. */
static bool grown(const TwinProblem *problem, double plain, GapEstimate *e)
{
    double counted = (double)counted_of(problem), floor_m2 = floor_of(problem->model), least = plain;
    const double rests[2] = {e->theta_d0, problem->q3[0] / problem->model->pitch}, gap = e->gap, growth = e->growth;

    for (int i = 0; i < 2; i++) {
        double x[3] = {gap, rests[i], growth}, variances[3];
        Squares sum = descend_all(problem, x, variances);
        if (sum.gram[0][0] < least) {
            least = sum.gram[0][0];
            if (least / counted <= floor_m2) {
                e->gap = x[0];
                e->theta_d0 = x[1];
                e->growth = x[2];
                e->std = sqrt(variances[0] * sum.noise);
                e->growth_std = sqrt(variances[2] * sum.noise);
                e->converged = 1;
                return true;
            }
        }
    }
    return false;
}

/* ---- the model with its errors ---- */

/* The coefficients at psi; with by >= 0 their derivatives by that entry of psi. */
static Coefficients coefficients(const ModelError *wrong, const double *psi, int64_t by)
{
    double pitch = 1.0 + psi[PITCH];
    int64_t width = wrong->lags.n + 1;
    Coefficients v = {{{0.0}}};

    for (int64_t t = 0; t < wrong->terms; t++) {
        const int64_t *power = wrong->powers + 5 * t;
        double size = exp((double)power[1] * psi[STIFFNESS] + (double)power[2] * psi[DAMPING]);
        if (power[3] && by != PITCH)
            size *= pitch;
        if (power[4] >= 0 && by != power[4])
            size *= psi[power[4]];
        if (by == STIFFNESS || by == DAMPING)
            size *= (double)power[1 + by];
        else if (by >= 0 && by != power[4] && !(by == PITCH && power[3]))
            continue;
        for (int64_t j = 0; j < width; j++)
            v.of[power[0]][j] += size * wrong->term[t * width + j];
    }
    return v;
}

/* The state z (n,) of a row of lags at rest for an input. */
static void rest_lags(const TwinLags *lags, double *z, double u)
{
    for (int64_t i = 0; i < lags->n; i++)
        z[i] = lags->start[i] * u;
}

/* The powers (n + 1,) of the lag of an input, of which the state z (n,) goes on by one sample. */
static void lag_powers(const TwinLags *lags, double *z, double u, double *powers)
{
    int64_t n = lags->n;

    powers[0] = u;
    for (int64_t i = n - 1; i >= 0; i--) {
        double next = lags->b[i] * u;
        powers[i + 1] = z[i] + lags->d[i] * u;
        for (int64_t j = 0; j <= i; j++)
            next += lags->phi[j * n + i] * z[j];
        z[i] = next;
    }
}

/* Sum of products of coefficients and powers of a lag, (n + 1,). */
static double through(const TwinLags *lags, const double *v, const double *powers)
{
    return dot(v, powers, lags->n + 1);
}

/* Which way q3 moves, -1 to 1: friction at a mass turns round within `presliding`. after : where it last turned, m. */
static double direction(const ModelError *wrong, double q3, double *after)
{
    *after = play(*after, q3, wrong->presliding);
    return (q3 - *after) / wrong->presliding;
}

/* Sums at a point x (fit_size,) of the fit: gap, start, growth rad/s and psi. slopes : with the derivatives. */
static void fit_squares(const TwinProblem *problem, const ModelError *wrong, const double *x, bool slopes,
                        FitSquares *sum)
{
    const TwinBuffer *in = &problem->data;
    const TwinLags *lags = &wrong->lags;
    int64_t n = fit_size(wrong), rows = slopes ? N_ROWS : 1;
    Believed by = {x[0], x[1], x[2] * problem->model->sample_time};
    Coefficients v = coefficients(wrong, x + 3, -1), dv[FIT_MOST - 3];
    double z[N_ROWS + 2][LAGS_MOST], R[N_ROWS + 2][LAGS_MOST + 1], at[N_ROWS], J[FIT_MOST], after = problem->q3[0];
    Blocks blocks = blocks_of(problem->model, counted_of(problem));

    *sum = (FitSquares){.error_error = 0.0};
    for (int64_t i = 3; slopes && i < n; i++)
        dv[i - 3] = coefficients(wrong, x + 3, i - 3);
    set_rows(by, at);
    for (int64_t k = 0; k < in->samples; k++) {
        push(by, in->theta_m[k], after_middle(k, in->samples), at);
        double friction = direction(wrong, problem->q3[k], &after);
        const double u[N_ROWS + 2] = {problem->q3[k], friction, at[0],
                                      at[1],          at[2],    at[3] * problem->model->sample_time};
        for (int64_t r = 0; r < 2 + rows; r++) {
            if (k == 0)
                rest_lags(lags, z[r], u[r]);
            lag_powers(lags, z[r], u[r], R[r]);
        }
        if (k < in->settle)
            continue;
        double error = through(lags, v.of[OF_Q3], R[0]) + through(lags, v.of[OF_THETA_D], R[2])
                       + through(lags, v.of[OF_FRICTION], R[1]) + v.of[OF_CONSTANT][0];
        sum->error_error += error * error;
        add_to_blocks(&blocks, k - in->settle, error);
        if (!slopes)
            continue;
        for (int64_t i = 0; i < 3; i++)
            J[i] = through(lags, v.of[OF_THETA_D], R[3 + i]);
        for (int64_t i = 3; i < n; i++)
            J[i] = through(lags, dv[i - 3].of[OF_Q3], R[0]) + through(lags, dv[i - 3].of[OF_THETA_D], R[2])
                   + through(lags, dv[i - 3].of[OF_FRICTION], R[1]) + dv[i - 3].of[OF_CONSTANT][0];
        for (int64_t i = 0; i < n; i++) {
            sum->error_by[i] += error * J[i];
            for (int64_t j = 0; j <= i; j++)
                sum->information[i * FIT_MOST + j] += J[i] * J[j];
        }
    }
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = i + 1; j < n; j++)
            sum->information[i * FIT_MOST + j] = sum->information[j * FIT_MOST + i];
    sum->noise = noise_of(problem->model, &blocks, sum->error_error / (double)counted_of(problem));
}

/* How precisely a deviation is known beforehand; 0: not at all. */
static double prior_of(const ModelError *wrong, int64_t i)
{
    return 1.0 / (wrong->deviations[i] * wrong->deviations[i]);
}

/* Covariance (n, n) of a fit, by rows of FIT_MOST; rows and columns of zeros for what neither data nor prior knows
 * (theta_d0 after a contact). */
static void covariance(const TwinProblem *problem, const ModelError *wrong, const FitSquares *sum, double noise,
                       double *A)
{
    int64_t n = fit_size(wrong);
    double least = LEAST_SEEN * (double)counted_of(problem) * problem->model->pitch * problem->model->pitch;
    double scale[FIT_MOST];

    for (int64_t i = 0; i < n; i++) {
        double own = sum->information[i * FIT_MOST + i];
        scale[i] = i > 1 || own > least ? 1.0 / sqrt(own / noise + prior_of(wrong, i)) : 0.0;
    }
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < n; j++) {
            double known = sum->information[i * FIT_MOST + j] / noise + (i == j ? prior_of(wrong, i) : 0.0);
            A[i * FIT_MOST + j] = known * scale[i] * scale[j];
        }
    pseudo_invert(n, FIT_MOST, A, 1e-12);
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < n; j++)
            A[i * FIT_MOST + j] *= scale[i] * scale[j];
}

/* Gauss-Newton step (n,) of a fit at x (n,) with the covariance A. */
static void fit_step(const ModelError *wrong, const FitSquares *sum, double noise, const double *x, const double *A,
                     double *step)
{
    int64_t n = fit_size(wrong);
    double slope[FIT_MOST];

    for (int64_t i = 0; i < n; i++)
        slope[i] = sum->error_by[i] / noise + prior_of(wrong, i) * x[i];
    for (int64_t i = 0; i < n; i++)
        step[i] = -dot(A + i * FIT_MOST, slope, n);
}

/* What the deviations of x (n,) from the believed model cost, in squares of standard deviations. */
static double deviation_of(const ModelError *wrong, const double *x)
{
    double sum = 0.0;

    for (int64_t i = 0; i < fit_size(wrong); i++)
        sum += prior_of(wrong, i) * x[i] * x[i];
    return sum;
}

/* x (n,) goes on by a step (n,), halved until it helps; returns whether it does. before : what there was to lower. */
static bool step_down(const TwinProblem *problem, const ModelError *wrong, double *step, double noise, double before,
                      double *x)
{
    int64_t n = fit_size(wrong);
    double moved[FIT_MOST];
    FitSquares sum;

    for (int i = 0; i < FIT_HALVINGS; i++) {
        for (int64_t j = 0; j < n; j++)
            moved[j] = x[j] + step[j];
        moved[0] = dmax(moved[0], 0.0);
        fit_squares(problem, wrong, moved, false, &sum);
        if (sum.error_error / noise + deviation_of(wrong, moved) <= before) {
            copy(moved, x, n);
            return true;
        }
        for (int64_t j = 0; j < n; j++)
            step[j] *= 0.5;
    }
    return false;
}

/* The standard error of a variance; inf where the data do not see what it is of. */
static double std_of(double variance) { return variance > 0.0 ? sqrt(variance) : INFINITY; }

/* The best x (n,) from a first one, its covariance A (n, n) by rows of FIT_MOST and the sums there; returns whether its
 * gap is stationary. */
static bool fit_all(const TwinProblem *problem, const ModelError *wrong, double *x, double *A, FitSquares *sum)
{
    double step[FIT_MOST];

    fit_squares(problem, wrong, x, true, sum);
    for (int i = 0; i < FIT_STEPS; i++) {
        double noise = sum->noise, gap = x[0], before = sum->error_error / noise + deviation_of(wrong, x);
        covariance(problem, wrong, sum, noise, A);
        fit_step(wrong, sum, noise, x, A, step);
        double enough = FITTED * sqrt(A[0]);
        if (!step_down(problem, wrong, step, noise, before, x))
            break;
        fit_squares(problem, wrong, x, true, sum);
        if (fabs(x[0] - gap) < enough)
            break;
    }
    covariance(problem, wrong, sum, sum->noise, A);
    fit_step(wrong, sum, sum->noise, x, A, step);
    return fabs(dmax(step[0], -x[0])) < FIT_STATIONARY * std_of(A[0]);
}

/* The same buffer, for which the model at psi is the twin's; eps_q (N,) room. */
static void with_model(const ModelError *wrong, const double *psi, double *eps_q, Explanation *out)
{
    const TwinLags *lags = &wrong->lags;
    TwinProblem *problem = &out->problem;
    Coefficients v = coefficients(wrong, psi, -1);
    double z[2][LAGS_MOST], R[2][LAGS_MOST + 1], after = problem->q3[0], d = 0.0;
    int64_t n = lags->n;

    for (int64_t k = 0; k < problem->data.samples; k++) {
        const double u[2] = {problem->q3[k], direction(wrong, problem->q3[k], &after)};
        for (int r = 0; r < 2; r++) {
            if (k == 0)
                rest_lags(lags, z[r], u[r]);
            lag_powers(lags, z[r], u[r], R[r]);
        }
        eps_q[k] = through(lags, v.of[OF_Q3], R[0]) + through(lags, v.of[OF_FRICTION], R[1]) + v.of[OF_CONSTANT][0];
    }
    for (int64_t i = 0; i < n; i++) {
        out->path_b[i] = out->path_start[i] = 0.0;
        for (int64_t j = 0; j <= n; j++) {
            out->path_b[i] += v.of[OF_THETA_D][j] * lags->b_of[j * n + i];
            out->path_start[i] += v.of[OF_THETA_D][j] * lags->start_of[j * n + i];
        }
    }
    for (int64_t j = 0; j <= n; j++)
        d += v.of[OF_THETA_D][j] * lags->d_of[j];
    problem->data.eps_q = eps_q;
    problem->data.path = (TwinPath){n, d, lags->phi, out->path_b, out->path_start};
}

/* The best explanation about an estimate; its fit_gap stays the minimiser of eq. (18). eps_q (N,) room. */
static void explain(const TwinProblem *problem, const ModelError *wrong, const GapEstimate *e, double *eps_q,
                    Explanation *out)
{
    double counted = (double)counted_of(problem), floor_m2 = floor_of(problem->model), x[FIT_MOST] = {0.0};
    double A[FIT_MOST * FIT_MOST];
    FitSquares sum;

    out->problem = *problem;
    out->estimate = *e;
    out->cost = e->cost;
    double plain = squares_at(problem, e->gap, e->theta_d0, e->growth).gram[0][0];
    out->doubted = plain / counted > floor_m2 && !grown(problem, plain, &out->estimate);
    if (!out->doubted)
        return;
    x[0] = e->gap, x[1] = e->theta_d0, x[2] = e->growth;
    bool converged = fit_all(problem, wrong, x, A, &sum);
    out->estimate.gap = x[0], out->estimate.theta_d0 = x[1], out->estimate.growth = x[2];
    out->estimate.cost = sum.error_error / counted;
    out->estimate.std = std_of(A[0]);
    out->estimate.growth_std = std_of(A[2 * FIT_MOST + 2]);
    out->estimate.converged = converged;
    if (!converged)
        out->estimate.end = NO_END;
    out->cost = out->estimate.cost + deviation_of(wrong, x) * sum.noise / counted;
    with_model(wrong, x + 3, eps_q, out);
}
