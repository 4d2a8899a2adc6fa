/* Novelty: the amplitude of a mode by a lock-in filter, and the indexes that tell which subsystem has changed. */
#include "core.h"

/* Amplitude of the mode after one more sample of the prediction error, in the error's unit.
 *
 * The oscillator is a rotating phasor, pulled back to the unit circle every sample, so that it neither grows nor fades
 * however long the run. */
static double lock_in(const LockIn *L, double error)
{
    double *state = L->state, *shown = state + 2 + 4 * L->sections, squares = 0.0;

    for (int channel = 0; channel < 2; channel++) {
        double value = 2.0 * error * state[channel];
        for (int64_t section = 0; section < L->sections; section++) {
            const double *c = L->sos + 6 * section;
            double *at = state + 2 + 4 * section + 2 * channel, out = c[0] * value + at[0];
            at[0] = c[1] * value - c[4] * out + at[1];
            at[1] = c[2] * value - c[5] * out;
            value = out;
        }
        squares += value * value;
        shown[channel] = value;
    }
    double real = state[0] * L->cos_step - state[1] * L->sin_step;
    double imag = state[0] * L->sin_step + state[1] * L->cos_step;
    double pull = 1.5 - 0.5 * (real * real + imag * imag);
    state[0] = real * pull;
    state[1] = imag * pull;
    return sqrt(squares);
}

/* Amplitudes (n,) of the mode along a record (n,) of errors. */
void dtb_lock_in(const LockIn *L, int64_t n, const double *errors, double *out)
{
    for (int64_t k = 0; k < n; k++)
        out[k] = lock_in(L, errors[k]);
}

static const double TURN = 6.283185307179586;

/* The torque that is left over at the newest sample, N m, and the speed, rad/s, both through two lags.
 *
 * past (8,) : angles and voltages before, newest first. lags (9,) : of torque, speed, dry friction's mean and spread (at
 * rest it takes whatever it has to, up to its level), and of the speed by a lag a quarter as long. */
static double residual_torque(
    const MotorEquation *E, double *past, double *lags, double theta, double u, double *through)
{
    double difference = E->a[0] * theta, speed = (theta - past[0]) / E->sample_time;

    for (int i = 0; i < 3; i++)
        difference += E->a[i + 1] * past[i] - E->b[i + 1] * past[4 + i];
    for (int i = 2; i > 0; i--) {
        past[i] = past[i - 1];
        past[4 + i] = past[3 + i];
    }
    past[0] = theta;
    past[4] = u;
    double known = E->known[1] + E->known[2] * sin(E->known[3] * theta + E->known[4]);
    double share = 1.0 - E->keep, mean = 0.0, spread = E->known[0];
    double fast = E->keep * E->keep * E->keep * E->keep;
    lags[8] = fast * lags[8] + (1.0 - fast) * speed;
    if (fabs(lags[8]) > E->rest) {
        mean = lags[8] > 0.0 ? -spread : spread;
        spread = 0.0;
    }
    double news[4] = {difference / E->scale - known, speed, mean, spread};
    for (int i = 0; i < 4; i++) {
        lags[2 * i] = E->keep * lags[2 * i] + share * news[i];
        lags[2 * i + 1] = E->keep * lags[2 * i + 1] + share * lags[2 * i];
    }
    double left = lags[1] - lags[5];
    *through = lags[3];
    return left - dmin(dmax(left, -lags[7]), lags[7]);
}

/* Torque left over, N m, and speed, rad/s, (n,) each, along a record of the angle, rad, and of the voltage, V. */
void dtb_residual_torque(
    const MotorEquation *E, double *past, double *lags, int64_t n, const double *theta, const double *u,
    double *torque, double *speed)
{
    for (int64_t k = 0; k < n; k++)
        torque[k] = residual_torque(E, past, lags, theta[k], u[k], speed + k);
}

/* One sample through a path: its output; the state moves on. */
static double path_step(const TwinPath *path, double *x, double u)
{
    double out = path_output(path, x, u);

    go_on_n(path->n, path, x, u);
    return out;
}

/* The state of the indexes as if everything had been at rest before the first sample. */
static void begin_indexes(Indexes *I, double theta_m, double q3, double u)
{
    I->begun[0] = 1.0;
    I->theta_d[0] = theta_m;
    for (int i = 0; i < 4; i++) {
        I->past[i] = theta_m;
        I->past[4 + i] = u;
    }
    rest_n(I->from_q3.n, &I->from_q3, I->by_q3, q3);
    rest_n(I->from_theta_d.n, &I->from_theta_d, I->by_theta_d, theta_m);
}

/* Frequency of the mode over that of the design, NaN while it is not known. real, imag : of the phasor, m. */
static double frequency_ratio(Indexes *I, double real, double imag)
{
    double before_real = I->phasor[0], before_imag = I->phasor[1], square = real * real + imag * imag;
    double keep = I->keep_turning, *means = I->means;

    I->phasor[0] = real;
    I->phasor[1] = imag;
    means[4] = keep * means[4] + (1.0 - keep) * square;
    if (!(square < means[4])) { /* driven, not swinging: what turns is no mode */
        means[0] = means[1] = I->begun[1] = 0.0;
        return NAN;
    }
    means[0] = keep * means[0] + (1.0 - keep) * (before_real * imag - before_imag * real);
    means[1] = keep * means[1] + (1.0 - keep) * (before_real * real + before_imag * imag);
    I->begun[1] += 1.0;
    if (I->begun[1] * I->sample_time * I->frequency < TURN || square < I->least_m * I->least_m)
        return NAN;
    return 1.0 + atan2(means[0], means[1]) / (I->sample_time * I->frequency);
}

/* The indexes after one more sample, into values (3,): ratio, N m, m. phasor (2,) : of the lock-in filter, m. */
static void index_step(
    Indexes *I, const double *phasor, double theta_m, double q3, double u, double gap_hat, double *values)
{
    double speed, *means = I->means;

    if (I->begun[0] == 0.0)
        begin_indexes(I, theta_m, q3, u);
    values[FREQUENCY] = frequency_ratio(I, phasor[0], -phasor[1]); /* the error's analytic signal */
    double torque = residual_torque(&I->motor, I->past, I->lags, theta_m, u, &speed);
    I->theta_d[0] = play(I->theta_d[0], theta_m, gap_hat);
    double error = path_step(&I->from_q3, I->by_q3, q3);
    error = error + path_step(&I->from_theta_d, I->by_theta_d, I->theta_d[0]);
    means[2] = I->keep * means[2] + (1.0 - I->keep) * torque * torque;
    means[3] = I->keep * means[3] + (1.0 - I->keep) * error * error;
    values[MOTOR] = sqrt(means[2]);
    values[STRUCTURE] = sqrt(means[3]);
}

/* The first armed index that is above its limit, which disarms it; -1 for none. It is armed again below `hysteresis`
 * times its limit. */
static int rising_index(Indexes *I, const double *values)
{
    int found = -1;

    for (int i = 0; i < N_INDEX; i++) {
        double size = i == FREQUENCY ? fabs(values[i] - 1.0) : values[i];
        if (I->armed[i] == 0.0) {
            if (!(size >= I->hysteresis * I->limits[i]))
                I->armed[i] = 1.0;
        } else if (size > I->limits[i] && found < 0) {
            I->armed[i] = 0.0;
            found = i;
        }
    }
    return found;
}
