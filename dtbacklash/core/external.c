/* A pass over a simulator's model: its own step, with laws and corrections between. */
#include "core.h"

/* a joint may turn within a step in which its speed could change by a part of it (ratio) */
static const double TURNS = 2.0;
/* a state that large is lost */
static const double LOST = 1e8;

/* What a simulator does instead of printing a warning. */
void dtb_ignore(const char *text) { (void)text; }

/* Whether no joint with a friction of a law comes near to rest within a far step. */
static int slides(const Model *M)
{
    for (int64_t e = 0; e < M->levels; e++) {
        int64_t j = M->at[M->level[e].at];
        if (!(fabs(M->v[j]) > TURNS * fabs(M->acceleration[j]) * (double)M->ratio * M->h))
            return 0;
    }
    return 1;
}

/* The commands that are held over `many` fine steps: their means. */
static void set_commands(const Model *M, int64_t first, int64_t many)
{
    for (int64_t a = 0; a < M->commands; a++) {
        double told = 0.0;
        for (int64_t i = first; i < first + many; i++)
            told += M->U[least_of(i, M->fine - 1) * M->commands + a];
        M->ctrl[a] = told / (double)many;
    }
}

/* One step over `many` fine ones; a friction that slides in a far one is a force. Efforts are held, at the positions in
 * its middle. */
static void stride(const Model *M, int64_t first, int64_t many)
{
    double h = (double)many * M->h, time = M->begin + ((double)first + 0.5 * (double)many) * M->h;

    set_commands(M, first, many);
    if (M->efforts || M->levels)
        set_zero(M->push, M->degrees);
    for (const Law *law = M->effort; law < M->effort + M->efforts; law++) {
        int64_t j = M->at[law->at];
        M->push[j] += body_effort(law, (BodyEffort){M->q[j] + 0.5 * h * M->v[j], M->v[j], time, 0.0});
    }
    copy(M->still, M->friction, M->degrees);
    for (const Law *law = M->level; law < M->level + M->levels; law++) {
        int64_t j = M->at[law->at];
        double side = M->v[j] >= 0.0 ? 1.0 : -1.0;
        double level = friction_of(law, (Contact){fabs(M->v[j]), side, M->load[j]});
        level = level > 0.0 ? level : 0.0;
        if (many > 1)
            M->push[j] -= side * level;
        else
            M->friction[j] += level;
    }
    M->step(many > 1 ? M->far : M->model, M->data);
}

/* From reading k to the next one: in far steps, and in small ones where a dry friction may turn. */
static void lead_on(const Model *M, int64_t k)
{
    for (int64_t s = k * M->whole; s < (k + 1) * M->whole; s += M->ratio) {
        if (M->ratio > 1 && slides(M))
            stride(M, s, M->ratio);
        else
            for (int64_t i = s; i < s + M->ratio; i++)
                stride(M, i, 1);
    }
}

/* Position, speed or acceleration of a joint with what the gap behind it adds. */
static inline double moved(const Model *M, int64_t joint, const double *motion)
{
    int64_t gap = M->behind[joint];
    return motion[M->at[joint]] + (gap >= 0 ? motion[gap] : 0.0);
}

/* What the sensors show of the state, into y (sensors,). */
static void show_sensors(const Model *M, double *y)
{
    if (M->forward)
        M->forward(M->model, M->data);
    for (int64_t i = 0; i < M->sensors; i++) {
        const double *sensor = M->sensor + i * N_MODEL_SENSOR;
        int64_t place = (int64_t)sensor[M_PLACE];
        double late = sensor[M_LATE];
        switch ((int)sensor[M_SHOWS]) {
        case SHOWS_POSITION: y[i] = moved(M, place, M->q) - late * moved(M, place, M->v); break;
        case SHOWS_VELOCITY: y[i] = moved(M, place, M->v) - late * moved(M, place, M->acceleration); break;
        case SHOWS_ACCELERATION: y[i] = moved(M, place, M->acceleration); break;
        case SHOWS_OUTPUT: y[i] = M->shown[place]; break;
        default: y[i] = M->load[M->at[place]];
        }
    }
    for (const Law *law = M->read; law < M->read + M->reads; law++)
        y[law->at] = shown(law, (Reading){y[law->at]});
}

/* Set the state to z. */
static void put_state(const Model *M, const double *z)
{
    int64_t n = M->joints;
    const double *gap = z + 2 * n + M->others;

    copy(z + 2 * n, M->more, M->others);
    for (int64_t j = 0; j < n; j++) {
        M->q[M->at[j]] = z[j];
        M->v[M->at[j]] = z[n + j];
        if (M->behind[j] >= 0) {
            M->q[M->behind[j]] = *gap++;
            M->v[M->behind[j]] = *gap++;
        }
    }
}

/* Fill z with the state. */
static void take(const Model *M, double *z)
{
    int64_t n = M->joints;
    double *gap = z + 2 * n + M->others;

    copy(M->more, z + 2 * n, M->others);
    for (int64_t j = 0; j < n; j++) {
        z[j] = M->q[M->at[j]];
        z[n + j] = M->v[M->at[j]];
        if (M->behind[j] >= 0) {
            *gap++ = M->q[M->behind[j]];
            *gap++ = M->v[M->behind[j]];
        }
    }
}

/* Set or take the state z. */
void dtb_model_put(const Model *M, const double *z) { put_state(M, z); }
void dtb_model_take(const Model *M, double *z) { take(M, z); }

/* Where a reading leads from a state z under forces (joints,) and commands that stay, into out; or what the sensors show
 * of it at once. */
void dtb_model_led(const Model *M, const double *z, const double *force, const double *command, int64_t far, double *out)
{
    M->back(M->model, M->data);
    put_state(M, z);
    for (int64_t j = 0; j < M->joints; j++)
        M->push[M->at[j]] = force[j];
    copy(command, M->ctrl, M->commands);
    if (!far) {
        show_sensors(M, out);
        return;
    }
    for (int64_t k = 0; k < M->whole; k++)
        M->step(M->model, M->data);
    take(M, out);
}

/* Correct the state by innovations d (sensors,) and gains (2 joints + others, sensors); the sum of squares of speeds. */
static double correct(const Model *M, const double *gains, const double *d)
{
    int64_t n = M->joints, m = M->sensors;
    double size = 0.0;

    for (int64_t joint = 0; joint < n; joint++) {
        int64_t j = M->at[joint];
        for (int64_t i = 0; i < m; i++) {
            M->q[j] += gains[joint * m + i] * d[i];
            M->v[j] += gains[(n + joint) * m + i] * d[i];
        }
        size += M->v[j] * M->v[j];
    }
    for (int64_t j = 0; j < M->others; j++)
        for (int64_t i = 0; i < m; i++)
            M->more[j] += gains[(2 * n + j) * m + i] * d[i];
    return size;
}

/* Predict N readings Y (N, sensors), NaN where one is missing, and correct by the gains K (., 2 joints + others, sensors)
 * of number which (N,). D, X (N, width) : filled with innovations, NaN from where it is lost, and states before. */
void dtb_model_observe(const Model *M, int64_t N, int64_t width, const double *Y, const double *K, const int64_t *which,
                       double *D, double *X)
{
    int64_t m = M->sensors, gains = (2 * M->joints + M->others) * m;

    for (int64_t k = 0; k < N; k++) {
        double *d = D + k * m;
        const double *read = Y + k * m;
        show_sensors(M, d);
        take(M, X + k * width);
        for (int64_t i = 0; i < m; i++)
            d[i] = isfinite(read[i]) ? read[i] - d[i] : 0.0;
        if (!(correct(M, K + which[k] * gains, d) < LOST)) {
            for (int64_t i = k * m; i < N * m; i++)
                D[i] = NAN;
            return;
        }
        if (k + 1 < N)
            lead_on(M, k);
    }
}

/* Where a reading leads from each of N states Z (N, width), into X; its last row stays. */
void dtb_model_onwards(const Model *M, int64_t N, int64_t width, const double *Z, double *X)
{
    for (int64_t k = 0; k < N - 1; k++) {
        put_state(M, Z + k * width);
        lead_on(M, k);
        take(M, X + k * width);
    }
}

/* What the sensors show of N states Z (N, width), each at the time and under the commands of its reading, into Y. */
void dtb_model_shown(const Model *M, int64_t N, int64_t width, const double *Z, double *Y)
{
    for (int64_t k = 0; k < N; k++) {
        put_state(M, Z + k * width);
        M->clock[0] = (double)(k * M->whole) * M->h;
        if (k)
            copy(M->U + (least_of(k * M->whole, M->fine) - 1) * M->commands, M->ctrl, M->commands);
        show_sensors(M, Y + k * M->sensors);
    }
}
