/* The closed loop: plant, sensors, controller and novelty indexes, sample by sample. */
#include "core.h"

/* What the sensors show at sample k, with noise and counts; the truth goes beside it. rate : of the gap, rad/s. */
static void measure(const Plant *P, State *S, const Signals *in, const Traces *out, int64_t k, double rate)
{
    Gap gap = {in->gap[k], rate};
    double *seen = out->seen + k * in->sensors, *truth = out->truth + k * in->sensors;

    sense(P, S, gap, seen);
    for (int64_t s = 0; s < in->sensors; s++) {
        double count = in->resolution[s];
        truth[s] = read_sensor(P, S, s, gap);
        if (in->noisy)
            seen[s] += in->noise[k * in->sensors + s];
        if (count > 0.0)
            seen[s] = count * floor(seen[s] / count + 0.5);
    }
}

/* Run the samples of a segment; returns the sample after the last one that was run, and why it ended in `why`: RAN,
 * NOVELTY, DIVERGED, or ALARM and an index. I : the indexes, or null. */
int64_t dtb_run_loop(
    const Plant *P, State *S, const Controller *C, ControllerState *X, const LockIn *L, Indexes *I, const Signals *in,
    const Traces *out, const Segment *over, int64_t *why)
{
    int64_t last = in->samples - 1;
    double before = over->before;

    *why = DIVERGED;
    for (int64_t k = over->first; k < over->stop; k++) {
        double rate = (in->gap[least_of(k + 1, last)] - in->gap[least_of(k, last - 1)]) / P->sample_time;
        measure(P, S, in, out, k, rate);
        const double *seen = out->seen + k * in->sensors;
        double theta_m = over->theta_m >= 0 ? seen[over->theta_m] : 0.0, q3 = over->q3 >= 0 ? seen[over->q3] : 0.0;
        double believed = dmax(over->gap + over->growth * (double)(k - over->since), 0.0);
        double toward = in->ahead ? in->moving[least_of(k + crossing_samples(C, believed), last)] : 0.0;
        double u = control_step(C, X, in->reference[k], theta_m, q3, believed, over->growth, toward, out->eps + k);
        out->u[k] = u;
        out->gap_hat[k] = believed;
        out->theta_d[k] = P->rotor >= 0 ? screw_angle(P, S, in->gap[k]) : 0.0;
        double level = out->novelty[k] = lock_in(L, out->eps[k]);
        if (!(fabs(q3) <= over->largest) || !isfinite(u))
            return k;
        if (k < last)
            advance(P, S, (double)k * P->sample_time, u, in->gap[k], in->gap[k + 1],
                    (Imposed){in->reference, in->samples, k});
        if (I)
            index_step(I, L->state + 2 + 4 * L->sections, theta_m, q3, u, believed, I->values + N_INDEX * k);
        if (level > over->novelty && !(before > over->novelty)) {
            *why = NOVELTY;
            return k + 1;
        }
        before = level;
        int risen = I ? rising_index(I, I->values + N_INDEX * k) : -1;
        if (risen >= 0) {
            *why = ALARM + risen;
            return k + 1;
        }
    }
    *why = RAN;
    return over->stop;
}

/* What every sensor measures, SI, and the screw's angle behind it, rad: y (sensors + 1,). */
static void show_truth(const Plant *P, State *S, Gap gap, double *y)
{
    for (int64_t s = 0; s < P->sensors; s++)
        y[s] = read_sensor(P, S, s, gap);
    y[P->sensors] = P->rotor >= 0 ? screw_angle(P, S, gap.start) : 0.0;
}

/* Run samples from number `first` on, with the command held, V, and show what they end at in y (sensors + 1,).
 *
 * gap, gap_to : half-gap at the start and after the first sample, rad. window (n,) : the last commands, the newest last,
 * where a positioner imposes them; the sample begins at entry `at` of it. */
void dtb_hold(
    const Plant *P, State *S, double start_s, int64_t first, int64_t samples, double u, double gap, double gap_to,
    double *window, int64_t n, int64_t at, double *y)
{
    double rate = 0.0;

    for (int64_t k = first; k < first + samples; k++) {
        for (int64_t j = 0; j < n - 1; j++)
            window[j] = window[j + 1];
        window[n - 1] = u;
        advance(P, S, start_s + (double)k * P->sample_time, u, gap, gap_to, (Imposed){window, n, at});
        rate = (gap_to - gap) / P->sample_time;
        gap = gap_to;
    }
    show_truth(P, S, (Gap){gap, rate}, y);
}

/* Velocity at which a friction contact slips while its base rests, m/s or rad/s. */
double dtb_slip_rate(const Plant *P, State *S, int64_t contact) { return slip_rate(P, S, S->x, contact, 0.0, 0.0); }
