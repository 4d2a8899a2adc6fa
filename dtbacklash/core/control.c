/* One sample of a controller: linear IMC, nonlinear IMC, a linear law, a predictive one, or open loop. */
#include "core.h"

/* More samples than any run has: what is cast to a whole number stays below. */
static const double MOST_SAMPLES = 1e15;

static double within(double value, double low, double high) { return dmin(dmax(value, low), high); }

/* c x, for a row c (n,). */
static double dot(const double *c, const double *x, int64_t n)
{
    double total = 0.0;

    for (int64_t i = 0; i < n; i++)
        total += c[i] * x[i];
    return total;
}

/* x = A x + B u. */
static void advance_model(const double *A, const double *B, double u, double *x, double *spare, int64_t n)
{
    for (int64_t i = 0; i < n; i++) {
        double total = B[i] * u;
        for (int64_t j = 0; j < n; j++)
            total += A[i * n + j] * x[j];
        spare[i] = total;
    }
    copy(spare, x, n);
}

/* The voltage within the amplifier's limit, V. */
static double limited(const Controller *C, double u) { return within(u, -C->limit, C->limit); }

/* The value that was given `samples` calls ago, linearly between two. line (n,) : the latest values, newest first. */
static double late(double *line, int64_t n, double samples, double value)
{
    if (samples <= 0.0)
        return value;
    for (int64_t i = n - 1; i > 0; i--)
        line[i] = line[i - 1];
    line[0] = value;
    int64_t whole = (int64_t)samples;
    double share = samples - (double)whole;
    return (1.0 - share) * line[whole] + share * line[whole + 1];
}

/* The command as it reaches the model of the plant, V. */
static double late_command(const Controller *C, ControllerState *X, double u)
{
    return late(X->lines, X->delay, C->late[0], u);
}

/* V against the torques on the motor that are known: those that hang on its angle from the measured one, rad. */
static double feed_forward(const Controller *C, ControllerState *X, double theta_m)
{
    const double *f = C->forward;
    int smooth = C->model == BARE || C->model == INNER_LOOP || C->model == INVERSE; /* counts would be differentiated */
    double speed = smooth ? X->m[1] : (theta_m - X->angle[0]) / C->sample_time;

    X->angle[0] = theta_m;
    return f[3] * speed - f[0] * sin(f[1] * theta_m + f[2]) - f[4];
}

/* The gap that the inverse is in grows by `growth`, rad: nothing moves, so that b stays and its share shrinks. */
static void grow(ControllerState *X, double growth)
{
    double before = X->inverse[I_GAP];

    if (growth == 0.0)
        return;
    X->inverse[I_GAP] = dmax(before + growth, 0.0);
    if (X->inverse[I_GAP] > 0.0)
        X->inverse[I_SHARE] = within(X->inverse[I_SHARE] * before / X->inverse[I_GAP], -1.0, 1.0);
}

/* Move the model of the inverse to a new estimate of the gap, rad, without a jump of the voltage.
 *
 * Where the motor lay in the old gap, as a share of it, it lies in the new one. The screw behind it, the structure and
 * theta_ref move by what b gains, as constants, which rings nothing. */
static void reseat(const Controller *C, ControllerState *X, double gap)
{
    if (gap == X->inverse[I_GAP])
        return;
    double gained = X->inverse[I_SHARE] * (gap - X->inverse[I_GAP]);
    X->inverse[I_GAP] = gap;
    X->theta_d[0] -= gained;
    for (int64_t i = 0; i < C->n_s; i++)
        X->s[i] -= gained * C->s_rest[i];
    for (int64_t i = 0; i < X->delay; i++)
        X->lines[2 * X->delay + i] -= gained * dot(C->sc, C->s_rest, C->n_s);
    for (int64_t i = 0; i < C->n_w; i++)
        X->w[i] -= gained * C->w_rest[i];
}

/* b crosses the gap by a sample's step towards a side, -1 or 1; returns what was left of its way, rad. */
static double cross(const Controller *C, ControllerState *X, double gap, double side)
{
    double left = (1.0 - X->inverse[I_SHARE] * side) * gap;

    X->inverse[I_SHARE] += side * dmin(left, C->crossing_step) / gap;
    return left;
}

/* How many samples before the load moves the motor has to set out, to have crossed a gap, rad, by then. */
static int64_t crossing_samples(const Controller *C, double gap)
{
    double samples = C->crossing_step > 0.0 ? ceil(2.0 * gap / C->crossing_step) : -1.0;

    return samples >= 0.0 ? (int64_t)dmin(samples, MOST_SAMPLES) + C->arriving : 0;
}

/* The reference that passes, m: while a jump waits for the motor to cross the gap, the one before it.
 *
 * The side to which the motor has to go follows from the jump alone, so no feedback of the output passes here. b is an
 * angle of the motor, and this is measured: friction keeps a servo from its reference. */
static double held(const Controller *C, ControllerState *X, double r, double gap)
{
    double jump = r - X->inverse[I_REFERENCE], *waiting = X->inverse + I_WAITING;

    if (C->crossing_step > 0.0 && gap > C->small_gap && fabs(jump) > C->jump) {
        if (cross(C, X, gap, jump > 0.0 ? 1.0 : -1.0) > C->crossing_step) {
            *waiting = (double)(C->arriving + C->patience);
            return X->inverse[I_REFERENCE];
        }
        if (*waiting > 0.0) {
            *waiting -= 1.0;
            if (*waiting > (double)C->patience || (*waiting > 0.0 && fabs(X->servo[2]) > C->near))
                return X->inverse[I_REFERENCE];
        }
    }
    X->inverse[I_REFERENCE] = r;
    *waiting = 0.0;
    return r;
}

/* Make up for what keeps the motor from its model while the reference is held. apart : theta_m less theta_m^, rad. */
static void catch_up(const Controller *C, ControllerState *X, double apart)
{
    if (X->inverse[I_WAITING] == 0.0) { /* always, with INNER_LOOP */
        X->servo[1] = apart;
        return;
    }
    X->servo[2] = X->servo[1] - apart;
    X->servo[0] = within(X->servo[0] + C->catching * X->servo[2], -C->catching_most, C->catching_most);
}

/* The model of the inverse takes the present gap, rad; returns the reference that passes, m. */
static double take_gap(const Controller *C, ControllerState *X, double r, double gap, double growth, double toward)
{
    if (C->model != INVERSE)
        return r;
    reseat(C, X, gap > 0.0 ? gap - growth : 0.0); /* what has grown from nothing forgets which tooth pushed */
    grow(X, growth);
    if (toward == 0.0)
        return held(C, X, r, gap);
    if (C->crossing_step > 0.0 && gap > 0.0)
        cross(C, X, gap, toward);
    X->inverse[I_REFERENCE] = r;
    X->inverse[I_WAITING] = 0.0;
    return r;
}

/* The next inverse of the backlash b, rad. error : theta_ref - theta_d^, rad. gap : estimated half-gap, rad.
 *
 * Across the gap the motor's angle is the loop's, not an integral of its error: b alone integrates, and no faster than
 * the output can tell whether the gap is there. Only the reference, which no feedback passes, moves it faster. */
static double next_inverse(const Controller *C, ControllerState *X, double r, double error, double gap)
{
    double ahead = dot(C->wc, X->w_r, C->n_w) + C->wd * r;

    advance_model(C->wa, C->wb, r, X->w_r, X->spare, C->n_w);
    double moved =
        C->crossing_ratio * (ahead - X->inverse[I_AHEAD]) + C->crossing_rate * C->sample_time * error;
    if (X->inverse[I_WAITING] == 0.0) /* else it is on its way, or waits there */
        X->inverse[I_SHARE] = within(X->inverse[I_SHARE] + moved / dmax(gap, C->small_gap), -1.0, 1.0);
    X->inverse[I_AHEAD] = ahead;
    return X->inverse[I_SHARE] * gap;
}

/* The first move of a predictive law, V: projected fast gradient steps (Nesterov) from the moves before. */
static double planned(const Controller *C, ControllerState *X, double forward)
{
    int64_t n = C->n_moves;
    double *last = X->moves, *ahead = X->moves + n, *spare = X->spare;

    for (int64_t i = 0; i < n; i++) {
        ahead[i] = last[i];
        spare[i] = dot(C->lf + i * C->n_law, X->law, C->n_law);
    }
    for (int64_t step = 0; step < C->search_steps; step++) {
        double changed = 0.0;
        for (int64_t i = 0; i < n; i++)
            spare[n + i] = ahead[i] - C->search[0] * (dot(C->lh + i * n, ahead, n) + spare[i]);
        for (int64_t i = 0; i < n; i++) {
            double found = within(spare[n + i], -C->limit - forward, C->limit - forward);
            changed = dmax(changed, fabs(found - last[i]));
            ahead[i] = found + C->search[1] * (found - last[i]);
            last[i] = found;
        }
        if (changed < C->found)
            break;
    }
    return last[0];
}

/* One sample of a linear law; returns the voltage, V. */
static double step_linear_law(const Controller *C, ControllerState *X, double r, double theta_m, double q3, double forward)
{
    double *x = X->law, u;
    int64_t n = C->n_law;

    if (C->n_moves > 0)
        u = planned(C, X, forward) + forward;
    else
        u = limited(C, dot(C->lc, x, n) + C->ld[0] * r + C->ld[1] * theta_m + C->ld[2] * q3 + forward);
    for (int64_t i = 0; i < n; i++) {
        const double *b = C->lb + 3 * i;
        double total = b[0] * r + b[1] * theta_m + b[2] * q3 + C->le[i] * (u - forward);
        for (int64_t j = 0; j < n; j++)
            total += C->la[i * n + j] * x[j];
        X->spare[i] = total;
    }
    copy(X->spare, x, n);
    return u;
}

/* The screw's angle that the model of the structure takes, rad. */
static double screw_of_model(const Controller *C, ControllerState *X, double theta_m, double gap)
{
    if (C->model == BARE)
        return C->structure == NIMC ? X->theta_d[0] : X->m[2];
    return X->theta_d[0] = play(X->theta_d[0], C->model == MEASURED ? theta_m : X->m[2], gap);
}

/* The angle on which the inner loop acts, rad: that of the screw, or with INVERSE that of the motor beside b. */
static double fed_back(
    const Controller *C, ControllerState *X, double r, double theta_m, double error, double theta_d, double gap)
{
    if (C->model == INVERSE)
        return theta_m - next_inverse(C, X, r, error, gap) - X->servo[0];
    if (C->structure != NIMC)
        return theta_m;
    X->theta_d[1] = play(X->theta_d[1], theta_m, gap);
    return C->model == INNER_LOOP ? X->theta_d[1] : theta_d;
}

/* The model of the motor moves on: driven by the voltage u, V, or in a complete model by its own inner loop. */
static void advance_motor(
    const Controller *C, ControllerState *X, double u, double theta_m, double theta_ref, double theta_d, double gap)
{
    if (C->model == BARE) {
        double z = theta_m - X->theta_d[0], omega = X->m[1];
        if (C->structure == NIMC && ((omega > 0.0 && z >= gap) || (omega < 0.0 && z <= -gap)))
            X->theta_d[0] += omega * C->sample_time; /* the paper's Eqs (16)-(17), integrated forward */
        advance_model(C->ma, C->mb, late_command(C, X, u), X->m, X->spare, C->n_m);
    } else if (C->model == INNER_LOOP || C->model == INVERSE) {
        int inverse = C->model == INVERSE;
        double ahead = inverse ? X->inverse[I_SHARE] * gap : 0.0;
        double own = late(X->lines + X->delay, X->delay, C->late[1], inverse ? X->m[2] : theta_d);
        catch_up(C, X, theta_m - own);
        double own_u = limited(C, C->gain * (theta_ref + ahead - own));
        advance_model(C->ma, C->mb, late_command(C, X, own_u), X->m, X->spare, C->n_m);
    }
}

/* The voltage, V, that a controller answers to what is measured, and its prediction error, m; its states move on.
 *
 * r, q3 : m (in open loop r is the command itself, V). theta_m : rad. gap_hat : estimated half-gap, rad. growth : by
 * how much of it the gap has grown since the sample before, rad; the rest of its change is a new estimate. toward : the
 * side, -1 or 1, to which the load moves dtb_crossing_samples() from now, where that is known. What is fed forward is
 * added behind the internal model, which does not know of the torques that it cancels. */
static double control_step(
    const Controller *C, ControllerState *X, double r, double theta_m, double q3, double gap_hat, double growth,
    double toward, double *eps)
{
    *eps = 0.0;
    if (C->structure == OPEN_LOOP)
        return r;
    double gap = C->structure == NIMC ? gap_hat : 0.0, u;
    double forward = C->forwards ? feed_forward(C, X, theta_m) : 0.0;
    if (C->structure == LINEAR)
        return step_linear_law(C, X, r, theta_m, q3, forward);
    r = take_gap(C, X, r, gap, growth, toward);
    *eps = q3 - late(X->lines + 2 * X->delay, X->delay, C->late[2], dot(C->sc, X->s, C->n_s));
    double error = r - *eps, theta_ref = dot(C->wc, X->w, C->n_w) + C->wd * error;
    advance_model(C->wa, C->wb, error, X->w, X->spare, C->n_w);
    if (C->model == EXACT) {
        u = limited(C, C->gain * (theta_ref - theta_m) + forward);
        advance_model(C->sa, C->sb, late_command(C, X, u - forward), X->s, X->spare, C->n_s);
        return u;
    }
    double theta_d = screw_of_model(C, X, theta_m, gap);
    u = limited(C, C->gain * (theta_ref - fed_back(C, X, r, theta_m, theta_ref - theta_d, theta_d, gap)) + forward);
    advance_model(C->sa, C->sb, theta_d, X->s, X->spare, C->n_s);
    advance_motor(C, X, u - forward, theta_m, theta_ref, theta_d, gap);
    return u;
}

/* ---- for Python ---- */

/* The voltage into out[0], V, the prediction error into out[1], m: see control_step(). */
void dtb_control_step(
    const Controller *C, ControllerState *X, double r, double theta_m, double q3, double gap_hat, double growth,
    double toward, double *out)
{
    out[0] = control_step(C, X, r, theta_m, q3, gap_hat, growth, toward, out + 1);
}

/* What is fed forward at a measured angle, rad; V. */
double dtb_feed_forward(const Controller *C, ControllerState *X, double theta_m) { return feed_forward(C, X, theta_m); }

/* How many samples before the load moves the motor has to set out, to have crossed a gap, rad, by then. */
int64_t dtb_crossing_samples(const Controller *C, double gap) { return crossing_samples(C, gap); }
