/* Exact propagation of a linear plant over a step and its halves: matrix exponentials and their integrals. */
#include "core.h"

/* terms of the Taylor series: the first one left out is below 1e-19 at |A| h = 1/2 */
enum { TAYLOR_TERMS = 16 };

/* Largest sum of absolute values in a row of A (rows, n). */
static double row_norm(int64_t rows, int64_t n, const double *A)
{
    double largest = 0.0;

    for (int64_t i = 0; i < rows; i++) {
        double sum = 0.0;
        for (int64_t j = 0; j < n; j++)
            sum += fabs(A[i * n + j]);
        largest = dmax(largest, sum);
    }
    return largest;
}

/* e = e^{Ah}, f1 = h phi_1(Ah), f2 = h phi_2(Ah), all (n, n), by their Taylor series. power, next (n, n) : room. */
static void set_series(int64_t n, const double *A, double h, double *e, double *f1, double *f2, double *power,
                       double *next)
{
    int64_t size = n * n;

    set_zero(e, size), set_zero(f1, size), set_zero(f2, size), set_zero(power, size);
    for (int64_t i = 0; i < n; i++)
        power[i * n + i] = 1.0;
    for (int k = 0; k < TAYLOR_TERMS; k++) { /* power = (A h)^k / k! */
        for (int64_t i = 0; i < size; i++) {
            e[i] += power[i];
            f1[i] += h * power[i] / (k + 1);
            f2[i] += h * power[i] / ((k + 1) * (k + 2));
        }
        multiply(n, n, n, power, A, next);
        for (int64_t i = 0; i < size; i++)
            power[i] = next[i] * h / (k + 1);
    }
}

/* The same over twice the step. product (n, n) : room. */
static void double_step(int64_t n, double *e, double *f1, double *f2, double *product)
{
    multiply(n, n, n, e, f2, product);
    for (int64_t i = 0; i < n * n; i++)
        f2[i] = 0.5 * (product[i] + f1[i] + f2[i]);
    multiply(n, n, n, e, f1, product);
    for (int64_t i = 0; i < n * n; i++)
        f1[i] += product[i];
    multiply(n, n, n, e, e, product);
    copy(product, e, n * n);
}

/* E (levels, n, n), P1 and P2 (levels, c, n), all transposed, of one mode A (n, n), G (c, n): over a step of
 * `step_s` / 2^level the transition matrix e^{Ah}, and the responses h phi_1(Ah) G and h phi_2(Ah) G to channels that
 * are constant and that rise from 0 to 1. norm : of A, largest sum of a row. work (5, n, n).
 *
 * By Taylor series where |A| h < 1/2, and by doubling for longer steps (scaling and squaring; Higham, Functions of
 * Matrices, 2008, chapter 10). */
static void discretise_mode(int64_t n, int64_t c, int64_t levels, const double *A, const double *G, double step_s,
                            double norm, double *E, double *P1, double *P2, double *work)
{
    double *e = work, *f1 = e + n * n, *f2 = f1 + n * n, *power = f2 + n * n, *next = power + n * n;
    double halvings = ceil(log2(dmax(norm * step_s, 1e-300) / 0.5));
    /* of a norm that is not finite the series is neither: any number of halvings will do */
    int64_t shortest = isfinite(halvings) && halvings > 0.0 ? (int64_t)halvings : 0;

    for (int64_t level = shortest > levels - 1 ? shortest : levels - 1; level >= 0; level--) {
        if (level >= shortest)
            set_series(n, A, ldexp(step_s, -(int)level), e, f1, f2, power, next);
        else
            double_step(n, e, f1, f2, next);
        if (level >= levels)
            continue;
        for (int64_t i = 0; i < n; i++)
            for (int64_t j = 0; j < n; j++)
                E[(level * n + j) * n + i] = e[i * n + j];
        double *p1 = P1 + level * c * n, *p2 = P2 + level * c * n;
        set_zero(p1, c * n), set_zero(p2, c * n);
        for (int64_t j = 0; j < c; j++)
            for (int64_t k = 0; k < n; k++)
                if (G[j * n + k] != 0.0)
                    for (int64_t i = 0; i < n; i++) {
                        p1[j * n + i] += f1[i * n + k] * G[j * n + k];
                        p2[j * n + i] += f2[i * n + k] * G[j * n + k];
                    }
    }
}

/* Propagation of all modes over a step of `step_s` seconds and its halves, see plant.h.
 * A (modes, n, n), G (modes, c, n); filled : E (modes, levels, n, n), P1, P2 (modes, levels, c, n). work (5, n, n). */
void dtb_discretise(int64_t modes, int64_t n, int64_t c, int64_t levels, const double *A, const double *G,
                    double step_s, double *E, double *P1, double *P2, double *work)
{
    double norm = row_norm(modes * n, n, A);

    for (int64_t m = 0; m < modes; m++)
        discretise_mode(n, c, levels, A + m * n * n, G + m * c * n, step_s, norm, E + m * levels * n * n,
                        P1 + m * levels * c * n, P2 + m * levels * c * n, work);
}
