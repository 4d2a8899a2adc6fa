/* What calls the law: its state, resets, new estimates, and readings that are not sane. */

#define GAP_MOST 6.2832 /* no half-gap, rad, is larger */

typedef struct {
    double half_gap, growth; /* believed, rad, and its growth in a sample: controller_set_gap sets both */
    double grows;            /* samples for which it goes on growing */
    double toward;           /* side, -1 or 1, to which the load moves next: controller_set_out; 0: not known */
    unsigned long held;      /* samples with a value that was not finite or not sane: the last good one stood for it */
    double good[3];          /* the last good r, y[0], y[1] */
    double eps;              /* prediction error of the last sample, m */
    double w[NW], m[NM], s[NS], theta_d[2], spare[NSPARE], angle[1], w_r[NW], inverse[5], servo[3], lines[3 * NLINE];
    double law[NL], moves[2 * NP];
} controller;

/* The state as the law takes it. */
static ControllerState state_of(controller *c)
{
    return (ControllerState){NLINE, c->w, c->m, c->s, c->theta_d, c->spare, c->angle, c->w_r, c->inverse, c->servo,
                             c->lines, c->law, c->moves};
}

/* At rest where y is, with y[1] as the reference: the first voltage is what is fed forward, and no bump. */
void controller_reset(controller *c, const double y[2])
{
    double theta_m = fabs(y[0]) <= SANE ? y[0] : 0.0, q3 = fabs(y[1]) <= SANE ? y[1] : 0.0, gap = c->half_gap;
    double whole = dot(LAW.sc, S_UNIT, LAW.n_s), left = theta_m - (whole > 0.0 ? q3 / whole : theta_m);

    memset(c, 0, sizeof *c);
    c->good[0] = c->good[2] = q3;
    c->good[1] = c->angle[0] = theta_m;
    c->half_gap = c->inverse[I_GAP] = gap;
    for (int64_t i = 0; i < LAW.n_law; i++)
        c->law[i] = X_REST[2 * i] * theta_m + X_REST[2 * i + 1] * q3;
    c->inverse[I_SHARE] = gap > 0.0 && LAW.structure == NIMC ? within(left / gap, -1.0, 1.0) : 0.0;
    double behind = theta_m - c->inverse[I_SHARE] * gap, asked = whole * behind, unit = dot(LAW.wc, W_UNIT, LAW.n_w);
    c->theta_d[0] = c->theta_d[1] = behind;
    c->m[NM - 1] = LAW.model == BARE ? behind : theta_m;
    for (int64_t i = 0; i < LAW.n_s; i++)
        c->s[i] = S_UNIT[i] * behind;
    for (int64_t i = 0; i < LAW.n_w; i++) {
        c->w[i] = unit > 0.0 ? W_UNIT[i] * (behind - LAW.wd * asked) / unit : 0.0;
        c->w_r[i] = W_UNIT[i] * q3;
    }
    c->inverse[I_AHEAD] = dot(LAW.wc, c->w_r, LAW.n_w) + LAW.wd * q3;
    c->inverse[I_REFERENCE] = q3;
    for (int i = 0; i < NLINE; i++) {
        c->lines[NLINE + i] = LAW.model == INVERSE ? theta_m : behind;
        c->lines[2 * NLINE + i] = asked;
    }
}

/* Before the first step. */
void controller_start(controller *c, const double y[2])
{
    c->half_gap = FIRST_HALF_GAP;
    controller_reset(c, y);
}

/* A new estimate of the half-gap, rad, that goes on growing by `growth`, rad/s, for `seconds`. Returns 0 and changes
   nothing where that is no gap: not finite, below 0, above a turn. */
int controller_set_gap(controller *c, double half_gap, double growth, double seconds)
{
    double end = half_gap + growth * seconds;

    if (!(half_gap >= 0.0 && half_gap <= GAP_MOST && seconds >= 0.0 && end >= 0.0 && end <= GAP_MOST))
        return 0;
    c->half_gap = half_gap;
    c->growth = growth * SAMPLE_TIME;
    c->grows = floor(seconds / SAMPLE_TIME + 0.5);
    return 1;
}

/* Where the reference is known ahead: to which side (-1, 1; 0: to none) the load moves in `controller_lead` from now. */
void controller_set_out(controller *c, int side) { c->toward = side > 0 ? 1.0 : side < 0 ? -1.0 : 0.0; }

/* How long before the load moves the motor has to set out to cross the gap, s. */
double controller_lead(const controller *c) { return (double)crossing_samples(&LAW, c->half_gap) * SAMPLE_TIME; }

/* One sample: reference m, y = (measured angle rad, measured output m); returns the voltage, V, within LIMIT. */
double controller_step(controller *c, double r, const double y[2])
{
    const double now[3] = {r, y[0], y[1]};
    ControllerState state = state_of(c);
    double growth = c->grows > 0.0 ? c->growth : 0.0;
    int bad = 0;

    for (int i = 0; i < 3; i++) {
        if (fabs(now[i]) <= SANE)
            c->good[i] = now[i];
        else
            bad = 1;
    }
    double u = control_step(&LAW, &state, c->good[0], c->good[1], c->good[2], c->half_gap, growth, c->toward, &c->eps);
    if (c->grows > 0.0) {
        c->half_gap = dmax(c->half_gap + c->growth, 0.0);
        c->grows -= 1.0;
    }
    c->held += (unsigned long)bad;
    return within(u, -LIMIT, LIMIT);
}
