/* Linear recursions of the predictor, and the gains of a linear plant whose forces are not all known.
 *
 * Matrices by rows, of a few states; `room` is memory to work in (dtb_room). What returns int: 0, or -1 where a matrix
 * is singular or not positive. */
#include "core.h"

/* by so much a covariance that has settled still changes from sample to sample, a share */
static const double SETTLED = 1e-9;

/* doubles that a function of n states and m readings needs to work in */
int64_t dtb_room(int64_t n, int64_t m) { return 9 * n * n + 6 * n * m + 4 * m * m + 4 * n + 4 * m; }

/* ---- small dense matrices ---- */

/* Y (a, c) = X (a, b) Z (b, c). */
static void multiply(int64_t a, int64_t b, int64_t c, const double *restrict X, const double *restrict Z,
                     double *restrict Y)
{
    for (int64_t i = 0; i < a; i++) {
        set_zero(Y + i * c, c);
        for (int64_t k = 0; k < b; k++) {
            double x = X[i * b + k];
            for (int64_t j = 0; j < c; j++)
                Y[i * c + j] += x * Z[k * c + j];
        }
    }
}

/* T (b, a) = X' of X (a, b). */
static void transpose(int64_t a, int64_t b, const double *restrict X, double *restrict T)
{
    for (int64_t i = 0; i < a; i++)
        for (int64_t j = 0; j < b; j++)
            T[j * a + i] = X[i * b + j];
}

/* Make X (n, n) symmetric. */
static void symmetrise(int64_t n, double *X)
{
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < i; j++)
            X[i * n + j] = X[j * n + i] = 0.5 * (X[i * n + j] + X[j * n + i]);
}

/* Largest size of an entry of X (n,). */
static double largest(int64_t n, const double *X)
{
    double found = 0.0;
    for (int64_t i = 0; i < n; i++)
        if (!(fabs(X[i]) <= found))
            found = fabs(X[i]);
    return found;
}

/* Exchange rows r and s of X (., columns). */
static void exchange(int64_t columns, double *X, int64_t r, int64_t s)
{
    for (int64_t j = 0; j < columns; j++) {
        double held = X[r * columns + j];
        X[r * columns + j] = X[s * columns + j];
        X[s * columns + j] = held;
    }
}

/* B (n, c) = M^-1 B by elimination with row pivots; M (n, n) is spent. */
static int solve(int64_t n, int64_t c, double *restrict M, double *restrict B)
{
    for (int64_t k = 0; k < n; k++) {
        int64_t pivot = k;
        for (int64_t i = k + 1; i < n; i++)
            if (fabs(M[i * n + k]) > fabs(M[pivot * n + k]))
                pivot = i;
        if (M[pivot * n + k] == 0.0)
            return -1;
        if (pivot != k) {
            exchange(n, M, pivot, k);
            exchange(c, B, pivot, k);
        }
        double inverse = 1.0 / M[k * n + k];
        for (int64_t i = k + 1; i < n; i++) {
            double factor = M[i * n + k] * inverse;
            for (int64_t j = k + 1; j < n; j++)
                M[i * n + j] -= factor * M[k * n + j];
            for (int64_t j = 0; j < c; j++)
                B[i * c + j] -= factor * B[k * c + j];
        }
    }
    for (int64_t k = n - 1; k >= 0; k--)
        for (int64_t j = 0; j < c; j++) {
            double s = B[k * c + j];
            for (int64_t i = k + 1; i < n; i++)
                s -= M[k * n + i] * B[i * c + j];
            B[k * c + j] = s / M[k * n + k];
        }
    return 0;
}

/* L (n, n), lower, with L L' = S (n, n). */
static int cholesky(int64_t n, const double *S, double *L)
{
    set_zero(L, n * n);
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j <= i; j++) {
            double s = S[i * n + j];
            for (int64_t k = 0; k < j; k++)
                s -= L[i * n + k] * L[j * n + k];
            if (i == j && !(s > 0.0))
                return -1;
            L[i * n + j] = i == j ? sqrt(s) : s / L[j * n + j];
        }
    return 0;
}

/* W = L^-1 of a lower L (n, n). */
static void invert_lower(int64_t n, const double *L, double *W)
{
    set_zero(W, n * n);
    for (int64_t j = 0; j < n; j++)
        for (int64_t i = j; i < n; i++) {
            double s = i == j ? 1.0 : 0.0;
            for (int64_t k = j; k < i; k++)
                s -= L[i * n + k] * W[k * n + j];
            W[i * n + j] = s / L[i * n + i];
        }
}

/* ---- recursions ---- */

/* Innovation r of d (m,), whitened by those before it. */
static inline double whiten(const double *W, const double *d, int64_t m, int64_t r)
{
    double s = 0.0;
    for (int64_t q = 0; q <= r; q++)
        s += W[r * m + q] * d[q];
    return s;
}

/* x (n,) = A (x + K d) + drive, summed in sum (n,); At (n, n) is A'. */
UNROLLED void advance_n(int64_t n, int64_t m, const double *restrict At, const double *restrict K,
                        const double *restrict d, const double *restrict drive, double *restrict x,
                        double *restrict sum)
{
    for (int64_t i = 0; i < n; i++)
        sum[i] = drive[i];
    for (int64_t j = 0; j < n; j++) {
        double corrected = x[j];
        for (int64_t r = 0; r < m; r++)
            corrected += K[j * m + r] * d[r];
        for (int64_t i = 0; i < n; i++)
            sum[i] += At[j * n + i] * corrected;
    }
    for (int64_t i = 0; i < n; i++)
        x[i] = sum[i];
}

/* The same with a size that is constant up to 8 states, so that sums are registers; wide (n,) is room for more. */
static void advance_state(int64_t n, int64_t m, const double *At, const double *K, const double *d, const double *drive,
                          double *x, double *wide)
{
    double sum[8];

    switch (n) {
    case 2: advance_n(2, m, At, K, d, drive, x, sum); break;
    case 3: advance_n(3, m, At, K, d, drive, x, sum); break;
    case 4: advance_n(4, m, At, K, d, drive, x, sum); break;
    case 5: advance_n(5, m, At, K, d, drive, x, sum); break;
    case 6: advance_n(6, m, At, K, d, drive, x, sum); break;
    case 7: advance_n(7, m, At, K, d, drive, x, sum); break;
    case 8: advance_n(8, m, At, K, d, drive, x, sum); break;
    default: advance_n(n, m, At, K, d, drive, x, wide);
    }
}

/* Sum of squares of the whitened innovations of a linear recursion, without what laws feel of its corrections.
 * A (n, n), C (m, n), K (g, n, m), W (g, m, m), which (N,). drive (N, n) : what is added to the state beside A x.
 * Y (N, m) readings, NaN where one is missing. x (n,) the first state, spent. */
double dtb_frozen(int64_t N, int64_t n, int64_t m, const double *A, const double *C, const double *K, const double *W,
                  const int64_t *which, const double *drive, const double *Y, double *x, double *room)
{
    double *d = room, *wide = d + m, *At = wide + n, total = 0.0;

    transpose(n, n, A, At);
    for (int64_t k = 0; k < N; k++) {
        const double *read = Y + k * m;
        for (int64_t r = 0; r < m; r++) {
            double s = read[r];
            for (int64_t i = 0; i < n; i++)
                s -= C[r * n + i] * x[i];
            d[r] = read[r] == read[r] ? s : 0.0;
        }
        for (int64_t r = 0; r < m; r++)
            if (read[r] == read[r]) {
                double s = whiten(W + which[k] * m * m, d, m, r);
                total += s * s;
            }
        advance_state(n, m, At, K + which[k] * n * m, d, drive + k * n, x, wide);
    }
    return total;
}

/* E (N, m) by which whitened innovations change with what is added to the state after each sample (drive (N, n)), and
 * to readings (shown (N, m)). missing (N, m). */
void dtb_driven(int64_t N, int64_t n, int64_t m, const double *A, const double *C, const double *K, const double *W,
                const int64_t *which, const double *drive, const double *shown, const unsigned char *missing, double *E,
                double *room)
{
    double *d = room, *wide = d + m, *x = wide + n, *At = x + n;

    transpose(n, n, A, At);
    set_zero(x, n);
    for (int64_t k = 0; k < N; k++) {
        const unsigned char *gone = missing + k * m;
        for (int64_t r = 0; r < m; r++) {
            double s = shown[k * m + r];
            for (int64_t i = 0; i < n; i++)
                s += C[r * n + i] * x[i];
            d[r] = gone[r] ? 0.0 : -s;
        }
        for (int64_t r = 0; r < m; r++)
            E[k * m + r] = gone[r] ? 0.0 : whiten(W + which[k] * m * m, d, m, r);
        advance_state(n, m, At, K + which[k] * n * m, d, drive + k * n, x, wide);
    }
}

/* E (N, m) by which whitened innovations change with an effort F (N,). b (n,) : what it adds to the state over a
 * sample. c (m,) : and to the readings behind it, or (at_once) to those of its own sample. */
void dtb_answer(int64_t N, int64_t n, int64_t m, const double *A, const double *C, const double *K, const double *W,
                const int64_t *which, const double *F, const double *b, const double *c, const unsigned char *missing,
                int64_t at_once, double *E, double *room)
{
    double *d = room, *wide = d + m, *x = wide + n, *drive = x + n, *At = drive + n;

    transpose(n, n, A, At);
    set_zero(x, n);
    for (int64_t k = 0; k < N; k++) {
        const unsigned char *gone = missing + k * m;
        double effort = at_once ? F[k] : k > 0 ? F[k - 1] : 0.0;
        for (int64_t r = 0; r < m; r++) {
            double s = c[r] * effort;
            for (int64_t i = 0; i < n; i++)
                s += C[r * n + i] * x[i];
            d[r] = gone[r] ? 0.0 : -s;
        }
        for (int64_t r = 0; r < m; r++)
            E[k * m + r] = gone[r] ? 0.0 : whiten(W + which[k] * m * m, d, m, r);
        for (int64_t i = 0; i < n; i++)
            drive[i] = b[i] * F[k];
        advance_state(n, m, At, K + which[k] * n * m, d, drive, x, wide);
    }
}

/* ---- gains ---- */

/* H (n, n) : the steady covariance of a predicted state, by the structure-preserving doubling algorithm.
 *
 * A (n, n), C (m, n), Q (n, n), R (m, m). Source: Chu, Fan, Lin, Linear Algebra Appl. 396 (2005) 55. It doubles the
 * horizon in each step; what does not settle in sixty has stopped mattering to what is read. */
int dtb_riccati(int64_t n, int64_t m, const double *A, const double *C, const double *Q, const double *R, double *H,
                double *room)
{
    int64_t nn = n * n;
    double *a = room, *g = a + nn, *w = g + nn, *v = w + nn, *aw = v + nn, *at = aw + nn, *more = at + nn,
           *one = more + nn;
    double *Cs = one + nn, *Ct = Cs + n * m, *Rs = Ct + n * m;

    copy(R, Rs, m * m);
    copy(C, Cs, m * n);
    if (solve(m, n, Rs, Cs) < 0)
        return -1;
    transpose(m, n, C, Ct);
    multiply(n, m, n, Ct, Cs, g);
    transpose(n, n, A, a);
    copy(Q, H, nn);
    for (int turn = 0; turn < 60; turn++) {
        multiply(n, n, n, g, H, w);
        for (int64_t i = 0; i < n; i++)
            w[i * n + i] += 1.0;
        transpose(n, n, a, at);
        transpose(n, n, w, one);
        copy(at, more, nn);
        if (solve(n, n, one, more) < 0)
            return -1;
        transpose(n, n, more, aw);
        copy(a, v, nn);
        if (solve(n, n, w, v) < 0)
            return -1;
        multiply(n, n, n, at, H, w);
        multiply(n, n, n, w, v, more);
        multiply(n, n, n, aw, g, w);
        multiply(n, n, n, w, at, one);
        multiply(n, n, n, aw, a, w);
        copy(w, a, nn);
        for (int64_t i = 0; i < nn; i++) {
            g[i] += one[i];
            H[i] += more[i];
        }
        symmetrise(n, g);
        symmetrise(n, H);
        if (!(largest(nn, more) > 1e-10 * largest(nn, H)))
            break;
    }
    return 0;
}

/* Gain K (n, m), whitening W (m, m) and *log, the log determinant, of the readings that are `there` (m,), for a
 * covariance P (n, n); 0 for the others. */
int dtb_update(int64_t n, int64_t m, const double *C, const double *R, const double *P, const unsigned char *there,
               double *K, double *W, double *log_det, double *room)
{
    double *Cs = room, *CP = Cs + m * n, *S = CP + m * n, *L = S + m * m, *white = L + m * m, *Ct = white + m * m;
    int64_t rows = 0;

    set_zero(K, n * m);
    set_zero(W, m * m);
    *log_det = 0.0;
    for (int64_t r = 0; r < m; r++)
        if (there[r])
            copy(C + r * n, Cs + n * rows++, n);
    if (rows == 0)
        return 0;
    multiply(rows, n, n, Cs, P, CP);
    transpose(rows, n, Cs, Ct);
    multiply(rows, n, rows, CP, Ct, S);
    for (int64_t r = 0, a = 0; r < m; r++) {
        if (!there[r])
            continue;
        for (int64_t q = 0, b = 0; q < m; q++)
            if (there[q])
                S[a * rows + b++] += R[r * m + q];
        a++;
    }
    symmetrise(rows, S);
    if (cholesky(rows, S, L) < 0)
        return -1;
    invert_lower(rows, L, white);
    if (solve(rows, n, S, CP) < 0)
        return -1;
    for (int64_t r = 0, a = 0; r < m; r++) {
        if (!there[r])
            continue;
        for (int64_t i = 0; i < n; i++)
            K[i * m + r] = CP[a * n + i];
        for (int64_t q = 0, b = 0; q < m; q++)
            if (there[q])
                W[r * m + q] = white[a * rows + b++];
        *log_det += 2.0 * log(L[a * rows + a]);
        a++;
    }
    return 0;
}

/* Whether a covariance stays as it was, in units of its states. */
static int has_settled(int64_t n, const double *P, const double *last)
{
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j <= i; j++)
            if (fabs(P[i * n + j] - last[i * n + j]) > SETTLED * sqrt(P[i * n + i] * P[j * n + j]))
                return 0;
    return 1;
}

/* Whether the same readings are there at two samples, (m,) each. */
static int same_readings(int64_t m, const unsigned char *one, const unsigned char *other)
{
    for (int64_t r = 0; r < m; r++)
        if (one[r] != other[r])
            return 0;
    return 1;
}

/* P (n, n) = A (M P M' + K R K') A' + Q with M = 1 - K C: a corrected covariance, one sample on (Joseph's form). */
static void predict(int64_t n, int64_t m, const double *A, const double *C, const double *Q, const double *R,
                    const double *K, double *P, double *room)
{
    int64_t nn = n * n;
    double *M = room, *T = M + nn, *X = T + nn, *Y = X + nn, *KR = Y + nn, *Kt = KR + n * m;

    multiply(n, m, n, K, C, M);
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < n; j++)
            M[i * n + j] = (i == j ? 1.0 : 0.0) - M[i * n + j];
    multiply(n, n, n, M, P, X);
    transpose(n, n, M, T);
    multiply(n, n, n, X, T, Y);
    multiply(n, m, m, K, R, KR);
    transpose(n, m, K, Kt);
    multiply(n, m, n, KR, Kt, X);
    for (int64_t i = 0; i < nn; i++)
        Y[i] += X[i];
    multiply(n, n, n, A, Y, X);
    transpose(n, n, A, T);
    multiply(n, n, n, X, T, P);
    for (int64_t i = 0; i < nn; i++)
        P[i] += Q[i];
    symmetrise(n, P);
}

/* Gains K (N, n, m), whitening W (N, m, m) and *logs, the sum of log determinants, of the first N samples.
 *
 * P (n, n) : covariance of the first state, spent. there (N, m) : whether each reading is. Joseph's form keeps P
 * positive; where it has settled, and the same readings are there until the end, so have the gains. */
int dtb_opening(int64_t N, int64_t n, int64_t m, const double *A, const double *C, const double *Q, const double *R,
                double *P, const unsigned char *there, double *K, double *W, double *logs, double *room)
{
    double *last = room, *rest = last + n * n, log_det;
    int64_t same = N - 1;

    *logs = 0.0;
    copy(P, last, n * n);
    while (same > 0 && same_readings(m, there + (same - 1) * m, there + (N - 1) * m))
        same--;
    for (int64_t k = 0; k < N; k++) {
        if (dtb_update(n, m, C, R, P, there + k * m, K + k * n * m, W + k * m * m, &log_det, rest) < 0)
            return -1;
        *logs += log_det;
        if (k > same && has_settled(n, P, last)) {
            for (int64_t j = k + 1; j < N; j++) {
                copy(K + k * n * m, K + j * n * m, n * m);
                copy(W + k * m * m, W + j * m * m, m * m);
            }
            *logs += (double)(N - 1 - k) * log_det;
            return 0;
        }
        copy(P, last, n * n);
        predict(n, m, A, C, Q, R, K + k * n * m, P, rest);
    }
    return 0;
}
