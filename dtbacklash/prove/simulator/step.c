/* A step of the concealing simulator: Runge-Kutta of fourth order with many fixed steps, bristles and springs.
 *
 * It shares no formula with the core, so that a diagnosis cannot succeed by recognising its own equations: dry friction
 * is LuGre's bristle, the teeth of the gear meet through a spring and a damper, clipping, dead zone and stop are
 * smooth, and delays interpolate a fine history. Bristles and yielding links are exact functions of the displacement
 * since the start of the step, for a constant level of friction, and so cannot become stiff.
 */

/* a tooth's contact: relaxation rate of its spring, 1/s, and the share of the motion that its damper carries at once.
 * A screw that is pushed at a steady speed lags by (1 - share)/rate = 0.5 us. */
static const double TOOTH_RATE = 2e4, TOOTH_SHARE = 0.99;
/* the rounding of |v|, relative to the speed at which friction matters, m/s or rad/s */
static const double SOFT_SPEED = 1e-6;
/* Runge and Kutta's stages: where in the step, and with which weight */
static const double STAGE[] = {0.0, 0.5, 0.5, 1.0}, WEIGHT[] = {1.0 / 6.0, 2.0 / 6.0, 2.0 / 6.0, 1.0 / 6.0};

/* Displacement and its rate, m and m/s or rad and rad/s. */
typedef struct {
    double at, rate;
} Motion;

static inline int64_t states_of(const Machine *M) { return 2 + 2 * M->bodies; }
static inline double soft_abs(double v) { return sqrt(v * v + SOFT_SPEED * SOFT_SPEED); }

/* Motion of an end of a link or bristle. */
static inline Motion end_motion(const Machine *M, const Memory *S, const double *x, int64_t end)
{
    if (end >= 0)
        return (Motion){x[2 + end], x[2 + M->bodies + end]};
    return end == BASE ? (Motion){S->scalar[S_BASE], S->scalar[S_BASE_RATE]} : (Motion){0.0, 0.0};
}

/* How far its second end goes beyond its first, which has a lever. */
static inline Motion stretch_between(const Machine *M, const Memory *S, const double *x, const int64_t *ends,
                                     double lever)
{
    Motion a = end_motion(M, S, x, ends[0]), b = end_motion(M, S, x, ends[1]);

    return (Motion){b.at - lever * a.at, b.rate - lever * a.rate};
}

/* Angle and rate of the screw behind the gear, rad and rad/s: the teeth push it through spring and damper, else it
 * holds its place. Notes whether they are in contact. */
static Motion screw_motion(const Machine *M, Memory *S, const double *x)
{
    double theta = x[2], omega = x[2 + M->bodies], gap = gap_beyond(M, M->drive[D_GAP], x[1]), play = theta - x[1];
    double pushed = TOOTH_SHARE * omega;

    S->scalar[S_CONTACT] = 1.0;
    if (!(gap > 0.0))
        return (Motion){theta, omega};
    if (play > gap)
        return (Motion){x[1], larger(0.0, TOOTH_RATE * (play - gap) + pushed)};
    if (play < -gap)
        return (Motion){x[1], smaller(0.0, TOOTH_RATE * (play + gap) + pushed)};
    S->scalar[S_CONTACT] = 0.0;
    return (Motion){x[1], 0.0};
}

/* Move the base by the screw, m and m/s, with the error of its pitch; dx : the rate of the screw's angle is written. */
static void move_by_screw(const Machine *M, Memory *S, const double *x, double *dx)
{
    const double *D = M->drive;
    Motion screw = screw_motion(M, S, x);

    dx[1] = screw.rate;
    S->scalar[S_BASE] = D[D_LEAD] * screw.at;
    S->scalar[S_BASE_RATE] = D[D_LEAD] * screw.rate;
    if (D[D_PITCH] != 0.0) {
        double at = D[D_WAVE] * screw.at + D[D_SHIFT];
        S->scalar[S_BASE] += D[D_PITCH] * (sin(at) - sin(D[D_SHIFT]));
        S->scalar[S_BASE_RATE] += D[D_PITCH] * D[D_WAVE] * cos(at) * screw.rate;
    }
}

/* Move what everything else hangs on: by a positioner, straight between two samples, or by the screw. */
static void move_base(const Machine *M, Memory *S, const double *x, double t, double *dx)
{
    double *on = S->scalar;

    if (M->drive[D_TRAVEL] == 0.0) {
        move_by_screw(M, S, x, dx);
        return;
    }
    on[S_BASE] = on[S_FROM] + on[S_IMPOSED_RATE] * (t - on[S_SINCE]);
    on[S_BASE_RATE] = on[S_IMPOSED_RATE];
    dx[1] = 0.0;
}

/* Pull two ends together, the first by its lever; returns the force on the rigid base, N. */
static inline double pull(Memory *S, const int64_t *ends, double lever, double force)
{
    if (ends[1] >= 0)
        S->force[ends[1]] -= force;
    if (ends[0] >= 0)
        S->force[ends[0]] += lever * force;
    return (ends[0] == BASE ? force : 0.0) - (ends[1] == BASE ? force : 0.0);
}

/* ---- forces ---- */

/* Stretch of link j. */
static inline Motion link_stretch(const Machine *M, const Memory *S, const double *x, int64_t j)
{
    return stretch_between(M, S, x, M->link_ends + 2 * j, M->link[j * N_LINK + L_LEVER]);
}

/* Force of link j, spring and damper and what else is in it; positive pulls its ends together, N or N m. */
static double link_force(const Machine *M, const Memory *S, int64_t j, Motion stretch, double t)
{
    const double *L = M->link + j * N_LINK, *memory = S->yielding_start + 2 * j;
    double rate = stretch.rate, s = L[L_LOST] > 0.0 ? held_stretch(stretch.at, L[L_LOST]) : stretch.at;
    double force = L[L_K] * s * (1.0 + L[L_DRIFT] * t) + L[L_C] * rate;

    if (L[L_CUBIC] != 0.0)
        force += L[L_CUBIC] * (s * s * s);
    if (L[L_QUADRATIC] != 0.0)
        force += L[L_QUADRATIC] * rate * soft_abs(rate);
    if (L[L_STOP] != 0.0) {
        double w = KNEE * fabs(L[L_CLEARANCE]) + 1e-8;
        force += L[L_STOP] * w * dtb_softplus((s - L[L_CLEARANCE]) / w);
    }
    if (L[L_FORCE] != 0.0)
        force += L[L_FORCE] * yielded_after(memory[0], stretch.at - memory[1], L[L_YIELD]);
    return link_beyond(M, force, j, s, rate);
}

/* Add the forces of the links; returns that on the rigid base, N. */
static double add_links(const Machine *M, Memory *S, const double *x, double t)
{
    double on_base = 0.0;

    for (int64_t j = 0; j < M->links; j++) {
        const double *L = M->link + j * N_LINK;
        const int64_t *ends = M->link_ends + 2 * j;
        double force = link_force(M, S, j, link_stretch(M, S, x, j), t);
        if (L[L_LOSS] != 0.0 && ends[0] >= 0)
            S->lost[ends[0]] += L[L_LOSS] * L[L_LEVER] * fabs(force);
        on_base += pull(S, ends, L[L_LEVER], force);
    }
    return on_base;
}

/* Friction of bristle c, N or N m, which moves its memory; LuGre's equations. A bristle whose level changes by itself
 * is remembered as a share of its most. */
static double bristle_force(const Machine *M, Memory *S, int64_t c, Motion slip)
{
    const double *F = M->friction + c * N_FRICTION, *start = S->bristle_start + 2 * c;
    double speed = slip.rate / F[F_SPEED], most = 1.0;
    double level = F[F_COULOMB] + F[F_STRIBECK] * exp(-(speed * speed));

    if (F[F_LOADED] != 0.0) {
        level += S->lost[M->friction_ends[2 * c + 1]];
        most = larger(level, LEAST_LEVEL) / F[F_BRISTLE];
    }
    double z = dtb_bristle_after(most * start[0], slip.at - start[1], level, F[F_BRISTLE]);
    double stretching = slip.rate - fabs(slip.rate) * z * F[F_BRISTLE] / larger(level, LEAST_LEVEL);
    S->bristle[2 * c] = z / most;
    S->bristle[2 * c + 1] = slip.at;
    return F[F_BRISTLE] * z + F[F_DAMPING] * stretching;
}

/* Add the forces of the bristles; returns that on the rigid base, N. */
static double add_frictions(const Machine *M, Memory *S, const double *x)
{
    double on_base = 0.0;

    for (int64_t c = 0; c < M->frictions; c++) {
        const int64_t *ends = M->friction_ends + 2 * c;
        on_base += pull(S, ends, 1.0, bristle_force(M, S, c, stretch_between(M, S, x, ends, 1.0)));
    }
    return on_base;
}

/* Add the efforts on single bodies. */
static void add_efforts(const Machine *M, Memory *S, const double *x)
{
    for (int64_t j = 0; j < M->bodies; j++) {
        const double *B = M->body + j * N_BODY;
        double q = x[2 + j], v = x[2 + M->bodies + j], effort = B[B_LOAD] - B[B_LEVELS] - B[B_VISCOUS] * v;
        if (B[B_DIFFERENCE] != 0.0)
            effort -= B[B_DIFFERENCE] * soft_abs(v);
        if (B[B_COGGING] != 0.0)
            effort += B[B_COGGING] * sin(B[B_WAVE] * q + B[B_PHASE]);
        if (B[B_WEIGHT] != 0.0)
            effort += B[B_WEIGHT] * (sin(q) * cos(B[B_ANGLE]) + cos(q) * sin(B[B_ANGLE]));
        S->force[j] += body_beyond(M, S, effort, j, q, v);
    }
}

/* Effort of a servo on its body, N or N m: its position loop asks for a speed, which is limited. */
static double servo_effort(const double *D, double volt, Motion body)
{
    double wanted = D[D_HOLD] * (volt - body.at);

    if (D[D_BRAKE] > 0.0) {
        double fastest = D[D_FAST] * D[D_BRAKE];
        wanted = larger(-fastest, smaller(wanted, fastest)) - D[D_BRAKE] * body.rate;
    }
    return larger(-D[D_STRONG], smaller(wanted, D[D_STRONG]));
}

/* What the motor, an ideal actuator or a servo does to the body that it drives, N m or N; dx : the rate of the first
 * state is written, of the current or of what has arrived of the command. */
static double drive_effort(const Machine *M, const Memory *S, const double *x, double volt, Motion body, double *dx)
{
    const double *D = M->drive;
    double effort, made;

    dx[0] = 0.0;
    if (D[D_EFFORT] != 0.0) {
        if (D[D_LAG] > 0.0)
            dx[0] = (volt - x[0]) / D[D_LAG];
        effort = made = D[D_EFFORT] * (D[D_LAG] > 0.0 ? x[0] : volt);
    } else if (D[D_HOLD] != 0.0) {
        effort = made = servo_effort(D, volt, body);
    } else {
        double i = x[0];
        dx[0] = (volt - D[D_R] * (1.0 + S->scalar[S_HEAT]) * i - D[D_KB] * body.rate) / D[D_L];
        made = D[D_KT] * i;
        effort = made * (1.0 + D[D_RIPPLE] * sin(D[D_PERIODS] * body.at + D[D_PHASE]));
    }
    return drive_beyond(M, S, effort, made, body.at, body.rate);
}

/* Drive the body that is driven; returns the effort, N or N m, which is added later. */
static double drive(const Machine *M, Memory *S, const double *x, double volt, double *dx)
{
    const double *D = M->drive;
    int64_t driven = (int64_t)D[D_BODY];
    double effort = 0.0;

    if (driven >= 0) {
        effort = drive_effort(M, S, x, volt, end_motion(M, S, x, driven), dx);
        S->lost[driven] += D[D_LOSS] * fabs(effort);
    }
    if (D[D_SCREW_LOSS] != 0.0 && S->scalar[S_CONTACT] > 0.0) {
        /* by the base's acceleration and load as they were a moment ago */
        double pushed = D[D_BASE_MASS] * D[D_LEAD] * dx[2 + M->bodies] - S->scalar[S_ON_BASE];
        S->lost[0] += D[D_SCREW_LOSS] * D[D_LEAD] * fabs(pushed);
    }
    return effort;
}

/* ---- the step ---- */

/* Velocities and accelerations of the bodies into dx; what the screw carries weighs on the rotor while in contact. */
static void accelerate(const Machine *M, Memory *S, const double *x, double *dx)
{
    const double *D = M->drive;

    for (int64_t j = 0; j < M->bodies; j++) {
        double inertia = M->inertia[j];
        if (j == 0 && D[D_SHARE] != 0.0 && S->scalar[S_CONTACT] > 0.0) {
            S->force[0] += D[D_SHARE] * D[D_LEAD] * S->scalar[S_ON_BASE];
            inertia += D[D_SHARE] * (D[D_LEAD] * D[D_LEAD]) * D[D_BASE_MASS];
        }
        dx[2 + j] = x[2 + M->bodies + j];
        dx[2 + M->bodies + j] = S->force[j] / inertia_beyond(M, inertia, j, x[2 + j]);
    }
}

/* Time derivative dx of the state x at time t, s, under a voltage, V. */
static void derivative(const Machine *M, Memory *S, const double *x, double t, double volt, double *dx)
{
    int64_t driven = (int64_t)M->drive[D_BODY];

    for (int64_t j = 0; j < M->bodies; j++)
        S->force[j] = S->lost[j] = 0.0;
    move_base(M, S, x, t, dx);
    double effort = drive(M, S, x, volt, dx);
    double on_base = add_links(M, S, x, t);
    S->scalar[S_ON_BASE] = on_base + add_frictions(M, S, x);
    add_efforts(M, S, x);
    if (driven >= 0)
        S->force[driven] += effort;
    accelerate(M, S, x, dx);
}

/* Move the memory of bristles and yielding links to the end of the step, at time t, s. */
static void keep_memories(const Machine *M, Memory *S, double t)
{
    move_base(M, S, S->x, t, S->rates);
    add_frictions(M, S, S->x);
    for (int64_t c = 0; c < 2 * M->frictions; c++)
        S->bristle_start[c] = S->bristle[c];
    for (int64_t j = 0; j < M->links; j++) {
        const double *L = M->link + j * N_LINK;
        double *memory = S->yielding_start + 2 * j;
        if (L[L_FORCE] == 0.0)
            continue;
        double s = link_stretch(M, S, S->x, j).at;
        memory[0] = yielded_after(memory[0], s - memory[1], L[L_YIELD]);
        memory[1] = s;
    }
}

/* Share by which the winding's resistance has grown with its heat, after h seconds. */
static double heated(const double *D, const Memory *S, double h)
{
    double target = D[D_HEAT] * D[D_R] * 0.5 * (S->start[0] * S->start[0] + S->x[0] * S->x[0]);

    return target + (S->scalar[S_HEAT] - target) * exp(-h / D[D_TAU]);
}

/* One step of h seconds from time t: four stages, then the memory of bristles, yielding links and the warm winding. */
static void advance(const Machine *M, Memory *S, double t, double h, double volt)
{
    int64_t n = states_of(M), unknowns = M->unknowns;
    const double *first = S->course + unknowns, *last = S->course + 2 * unknowns;

    for (int64_t i = 0; i < n; i++)
        S->start[i] = S->trial[i] = S->total[i] = S->x[i];
    for (int stage = 0; stage < 4; stage++) {
        for (int64_t r = 0; r < unknowns; r++)
            S->course[r] = first[r] + STAGE[stage] * (last[r] - first[r]);
        derivative(M, S, S->trial, t + STAGE[stage] * h, volt, S->rates);
        double ahead = stage < 3 ? STAGE[stage + 1] * h : 0.0;
        for (int64_t i = 0; i < n; i++) {
            S->total[i] += h * WEIGHT[stage] * S->rates[i];
            S->trial[i] = S->start[i] + ahead * S->rates[i];
        }
    }
    for (int64_t i = 0; i < n; i++)
        S->x[i] = S->total[i];
    if (M->drive[D_HEAT] > 0.0)
        S->scalar[S_HEAT] = heated(M->drive, S, h);
    if (gap_beyond(M, M->drive[D_GAP], S->x[1]) == 0.0)
        S->x[1] = S->x[2];
    keep_memories(M, S, t + h);
}
