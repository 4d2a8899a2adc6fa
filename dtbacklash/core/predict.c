/* A plant along a recording: from rest, corrected at each reading, or led on from given states. */
#include "core.h"

/* The first function of a law at N states (N, states), into out (N,). */
void dtb_law_values(const Law *law, int64_t N, int64_t states, const double *at, double *out)
{
    for (int64_t k = 0; k < N; k++)
        out[k] = law->formula[0] ? dtb_formula(law->formula[0], at + k * states, law->p)
                                 : ((double (*)(const double *, const double *))law->call[0])(at + k * states, law->p);
}

/* What sensors show now, into y (sensors,). */
void dtb_sense(const Plant *P, State *S, double gap, double gap_rate, double *y)
{
    sense(P, S, (Gap){gap, gap_rate}, y);
}

/* What the amplifier makes of each of N commands. */
void dtb_amplified(const Plant *P, const double *u, int64_t N, double *out)
{
    for (int64_t k = 0; k < N; k++)
        out[k] = amplify(P, u[k]);
}

/* Simulate N samples. gap (N + 1,) half-gap, theta (N + 1,) imposed angle; filled : y (N + 1, sensors) what sensors
 * show, x (N + 1, n) states, theta_d (N + 1,) the screw's angle; their first rows are there already. */
void dtb_run(const Plant *P, State *S, int64_t N, const double *u, const double *gap, const double *theta,
             int64_t angles, double *y, double *x, double *theta_d)
{
    for (int64_t k = 0; k < N; k++) {
        double rate = (gap[k + 1] - gap[k]) / P->sample_time;
        advance(P, S, (double)k * P->sample_time, u[k], gap[k], gap[k + 1], (Imposed){theta, angles, k});
        sense(P, S, (Gap){gap[k + 1], rate}, y + (k + 1) * P->sensors);
        copy(S->x, x + (k + 1) * P->n, P->n);
        theta_d[k + 1] = P->rotor < 0 ? S->gear[0] : screw_angle(P, S, gap[k + 1]);
    }
}

/* What is not at rest slips: a state that is not known yet is corrected to one that moves. */
static void let_slip(const Plant *P, State *S, double gap)
{
    double theta = P->imposed ? S->gear[0] : screw_angle(P, S, gap);

    for (int64_t c = 0; c < P->frictions; c++)
        if (S->mode[1 + c] == 0)
            S->mode[1 + c] = sign_of(slip_rate(P, S, S->x, c, theta, 0.0));
}

/* Correct the state by the m readings of sample k, of which sensors show y; e, d (m,), z (n,) : filled with whitened
 * innovations, innovations, and the state before. */
UNROLLED void correct_n(int64_t m, const Plant *P, State *S, const Correction *by, int64_t k, const double *restrict y,
                        double *restrict e, double *restrict d, double *restrict z)
{
    int64_t n = P->n, free = P->rotor >= 0 && S->mode[0] == FREE, gains = (free ? 0 : by->gains) + by->which[k];
    const double *restrict K = by->K + gains * n * m, *restrict W = by->W + gains * m * m,
                           *restrict read = by->Y + k * m;
    double *restrict x = S->x;

    for (int64_t r = 0; r < m; r++)
        d[r] = read[r] == read[r] ? read[r] - y[by->chan[r]] : 0.0;
    for (int64_t r = 0; r < m; r++) {
        double s = 0.0;
        for (int64_t q = 0; q <= r; q++)
            s += W[r * m + q] * d[q];
        e[r] = read[r] == read[r] ? s : 0.0;
    }
    for (int64_t i = 0; i < n; i++) {
        double s = z[i] = x[i];
        for (int64_t r = 0; r < m; r++)
            s += K[i * m + r] * d[r];
        x[i] = s;
    }
    for (int64_t s = 0; s < P->sensors; s++) { /* what senses goes along with what it is corrected to */
        double at = P->sensor[s * N_SENSOR + Y_INDEX];
        if (P->sensor_play[s] > 0.0 && at >= 0.0)
            S->played[s] += S->x[(int64_t)at] - z[(int64_t)at];
    }
}

/* Predict each sample, compare it with what was read, and correct the state by it.
 *
 * u (N,), gap, theta : as for the simulation. rise (N,), ramp (n,) : by how much the command rises within a sample, and
 * what a rise of 1 about its mean adds to the state. y (sensors,) : room. E, D (N, m), X (N, n) : filled with whitened
 * innovations, innovations, and states before each correction. */
void dtb_observe(const Plant *P, State *S, const Correction *by, const double *u, const double *rise,
                 const double *ramp, double gap, const double *theta, int64_t angles, double *E, double *X, double *D,
                 double *y)
{
    for (int64_t k = 0; k < by->samples; k++) {
        sense(P, S, (Gap){gap, 0.0}, y);
        double *e = E + k * by->readings, *d = D + k * by->readings, *z = X + k * P->n;
        switch (by->readings) {
        case 1: correct_n(1, P, S, by, k, y, e, d, z); break;
        case 2: correct_n(2, P, S, by, k, y, e, d, z); break;
        case 3: correct_n(3, P, S, by, k, y, e, d, z); break;
        case 4: correct_n(4, P, S, by, k, y, e, d, z); break;
        default: correct_n(by->readings, P, S, by, k, y, e, d, z);
        }
        if (k < by->opening)
            let_slip(P, S, gap);
        if (k + 1 == by->samples)
            break;
        advance(P, S, (double)k * P->sample_time, u[k], gap, gap, (Imposed){theta, angles, k});
        for (int64_t i = 0; rise[k] != 0.0 && i < P->n; i++)
            S->x[i] += ramp[i] * rise[k];
    }
}

/* Where one sample leads from each of the states Z (N, width), into X (N, width); the last row stays. */
void dtb_onwards(const Plant *P, State *S, int64_t N, const double *u, double gap, const double *theta, int64_t angles,
                 int64_t width, const double *Z, double *X)
{
    for (int64_t k = 0; k + 1 < N; k++) {
        copy(Z + k * width, S->x, width < P->n ? width : P->n);
        advance(P, S, (double)k * P->sample_time, u[k], gap, gap, (Imposed){theta, angles, k});
        copy(S->x, X + k * width, width);
    }
}

/* What sensors that are not late show of the states Z (N, width), into Y (N, sensors). */
void dtb_shown(const Plant *P, State *S, int64_t N, double gap, int64_t width, const double *Z, double *Y)
{
    for (int64_t k = 0; k < N; k++) {
        copy(Z + k * width, S->x, width < P->n ? width : P->n);
        sense(P, S, (Gap){gap, 0.0}, Y + k * P->sensors);
    }
}
