/* The concealing simulator's laws with corners or memory, formulated otherwise than in the core; and those that the
 * catalogue does not have, a row of `unknown` each. */
#include <math.h>
#include <stdint.h>

#include "machine.h"

/* width of the rounding of a knee, relative to where it lies */
static const double KNEE = 2e-3;
/* a level of friction that holds nothing is taken for this one, N or N m */
static const double LEAST_LEVEL = 1e-300;

static inline double smaller(double a, double b) { return b < a ? b : a; }
static inline double larger(double a, double b) { return b > a ? b : a; }

/* log(1 + e^x) without overflow. */
double dtb_softplus(double x) { return x > 0.0 ? x + log1p(exp(-x)) : log1p(exp(x)); }

/* Voltage behind gain, dead zone and limiter with rounded knees. V -> V. */
static double amplify(const double *D, double u)
{
    double v = D[D_GAIN] * u;

    if (D[D_DEAD] > 0.0) {
        double w = KNEE * D[D_DEAD];
        v = w * (dtb_softplus((v - D[D_DEAD]) / w) - dtb_softplus((-v - D[D_DEAD]) / w));
    }
    if (D[D_LIMIT] < INFINITY) {
        double w = KNEE * D[D_LIMIT];
        v += w * (dtb_softplus((-v - D[D_LIMIT]) / w) - dtb_softplus((v - D[D_LIMIT]) / w));
    }
    return v;
}

/* Mean voltage, V, from `begin` to `end` (shares of sample k): the command held over each sample, D_DELAY late. */
static double voltage(const Machine *M, const double *u, int64_t k, double begin, double end)
{
    double late = M->drive[D_DELAY] / M->sample_time;
    double a = (double)k + begin - late, b = (double)k + end - late;
    double first = floor(a + 1e-9), last = floor(b - 1e-9);
    double v = last >= 0.0 ? amplify(M->drive, u[(int64_t)last]) : 0.0;

    if (first < last) {
        double before = first >= 0.0 ? amplify(M->drive, u[(int64_t)first]) : 0.0;
        v = (before * (last - a) + v * (b - last)) / (b - a);
    }
    return v;
}

/* Deflection of LuGre's bristle, m or rad, after a relative displacement at a level of friction that stays: exact.
 * Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Automat. Contr. 40 (1995) 419. */
double dtb_bristle_after(double z, double shift, double level, double stiffness)
{
    double most = larger(level, LEAST_LEVEL) / stiffness;
    double rest = shift > 0.0 ? most : -most;

    return rest + (z - rest) * exp(-fabs(shift) / most);
}

/* Share of the yield force in a link after a displacement: straight back to zero, then an exponential to one. */
static double yielded_after(double z, double shift, double displacement)
{
    double side = shift > 0.0 ? 1.0 : -1.0;
    double w = z * side, way = fabs(shift) / displacement;

    if (w < 0.0) {
        if (way < -w)
            return (w + way) * side;
        way += w;
        w = 0.0;
    }
    return (1.0 - (1.0 - w) * exp(-way)) * side;
}

/* What is left of a stretch behind a lost motion, half of it to each side, with rounded corners, m or rad. */
static double held_stretch(double s, double lost)
{
    double half = 0.5 * lost, w = KNEE * lost;

    return w * (dtb_softplus((s - half) / w) - dtb_softplus((-s - half) / w));
}

/* ---- the laws that the catalogue does not have ---- */

static inline const double *unknown_of(const Machine *M, int64_t r) { return M->unknown + r * N_UNKNOWN; }
static inline int kind_of(const double *U) { return (int)U[U_KIND]; }

/* Whether a law acts at body, link or sensor j. */
static inline int stands_at(const double *U, int64_t j) { return (int64_t)U[U_PLACE] == j; }

/* Half-gap of a gear whose play depends on the angle of the screw, rad. */
static double gap_beyond(const Machine *M, double gap, double theta)
{
    for (int64_t r = 0; r < M->unknowns; r++) {
        const double *U = unknown_of(M, r);
        if (kind_of(U) == ANGULAR_PLAY)
            gap += U[U_SIZE] * (1.0 + 0.9 * sin(theta * U[U_SCALE]));
    }
    return gap;
}

/* Force of link j, N or N m, whose stiffness depends on its stretch (steep at its root) or on its rate. */
static double link_beyond(const Machine *M, double force, int64_t j, double s, double rate)
{
    double k = M->link[j * N_LINK + L_K];

    for (int64_t r = 0; r < M->unknowns; r++) {
        const double *U = unknown_of(M, r);
        double size = U[U_SIZE], scale = U[U_SCALE], root = 0.02 * scale;
        if (!stands_at(U, j))
            continue;
        if (kind_of(U) == ROOT_SPRING)
            force += size * k * s * sqrt(scale) / pow(s * s + root * root, 0.25);
        else if (kind_of(U) == SPEED_STIFFENING)
            force += size * k * s * fabs(rate) / scale;
    }
    return force;
}

/* Effort of law r on the body at which it stands, N or N m. */
static double effort_beyond(const Machine *M, const Memory *S, int64_t r, double inertia, double q, double v)
{
    const double *U = unknown_of(M, r);
    double size = U[U_SIZE], scale = U[U_SCALE], now = S->course[r];

    switch (kind_of(U)) {
    case POSITION_DAMPING: return -(size * ((q / scale) * (q / scale)) * v);
    case DISTURBANCE:
    case COLOURED_FORCE: return size * now;
    case POSITION_MASS: return -(0.5 * inertia * size / scale * v * v);
    case WANDERING_FRICTION: return -(size * now * v / sqrt(v * v + scale * scale));
    case DOUBLE_RIPPLE: return size * (sin(U[U_WAVE] * q + U[U_PHASE]) + scale * sin(U[U_SECOND] * q + U[U_SHIFT]));
    default: return 0.0;
    }
}

/* Effort on body j, with what the catalogue does not have, N or N m. */
static double body_beyond(const Machine *M, const Memory *S, double effort, int64_t j, double q, double v)
{
    for (int64_t r = 0; r < M->unknowns; r++)
        if (stands_at(unknown_of(M, r), j))
            effort += effort_beyond(M, S, r, M->inertia[j], q, v);
    return effort;
}

/* Inertia of body j where it changes with the position, kg or kg m2. */
static double inertia_beyond(const Machine *M, double inertia, int64_t j, double q)
{
    for (int64_t r = 0; r < M->unknowns; r++) {
        const double *U = unknown_of(M, r);
        if (kind_of(U) == POSITION_MASS && stands_at(U, j))
            inertia *= larger(0.1, 1.0 + U[U_SIZE] * q / U[U_SCALE]);
    }
    return inertia;
}

/* Effort of a drive, N or N m, whose gain depends on direction, position or time; `made` : without that. */
static double drive_beyond(const Machine *M, const Memory *S, double effort, double made, double q, double v)
{
    for (int64_t r = 0; r < M->unknowns; r++) {
        const double *U = unknown_of(M, r);
        double size = U[U_SIZE];
        switch (kind_of(U)) {
        case DIRECTIONAL_TORQUE: effort += made * size * tanh(v / U[U_SCALE]); break;
        case POSITION_GAIN: effort += made * size * tanh(q / U[U_SCALE]); break;
        case GAIN_DRIFT: effort += made * size * S->course[r]; break;
        default: break;
        }
    }
    return effort;
}

/* By how much law U changes a reading y of its own sensor, SI; `now` : its course. A scale that ripples over the
 * reading is right at zero, where it starts. */
static double error_beyond(const double *U, double y, double now)
{
    double size = U[U_SIZE];

    switch (kind_of(U)) {
    case INTERPOLATION: return size * (sin(U[U_WAVE] * y + U[U_PHASE]) - sin(U[U_PHASE]));
    case CURVED_SCALE: return size * y * y / U[U_SCALE];
    case READING_DRIFT: return size * now;
    default: return 0.0;
    }
}

/* What sensor s reads instead of y, which changes at `rate`: errors of scale and clock. courses (unknowns,). */
static double reading_beyond(const Machine *M, double y, double rate, int64_t s, const double *courses)
{
    double read = y;

    for (int64_t r = 0; r < M->unknowns; r++) {
        const double *U = unknown_of(M, r);
        if (kind_of(U) == CLOCK_JITTER)
            read += rate * U[U_SIZE] * courses[r];
        else if (stands_at(U, s))
            read += error_beyond(U, y, courses[r]);
    }
    return read;
}
