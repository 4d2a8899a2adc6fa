/* The law: dtbacklash/control/laws.py and linear_law.py, line by line. C99, no library but math.h, no memory that is asked for. */

#define IMC 0
#define NIMC 1
#define LINEAR 3
#define BARE 0
#define MEASURED 1
#define INNER_LOOP 2
#define EXACT 3
#define INVERSE 4

#define SANE 1e6       /* no measured angle, rad, output or reference, m, is larger */
#define GAP_MOST 6.2832 /* no half-gap, rad, is larger */

typedef struct {
    double half_gap, growth; /* believed, rad, and its growth in a sample: controller_set_gap sets both */
    double grows;            /* samples for which it goes on growing */
    double toward;           /* side, -1 or 1, to which the load moves next: controller_set_out; 0: not known */
    unsigned long held;      /* samples with a value that was not finite or not sane: the last good one stood for it */
    double good[3];          /* the last good r, y[0], y[1] */
    double w[NW], m[NM], s[NS], w_r[NW], law[NL], moves[NP], lines[3][NLINE];
    double screw, screw_measured, angle, share, ahead, gap, through, waits, caught, apart, behind;
} controller;

static double clip(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

static double play(double screw, double motor, double gap) {
    double pushed = screw > motor - gap ? screw : motor - gap;
    return pushed < motor + gap ? pushed : motor + gap;
}

static double sum(double total, const double *C, const double *x, int n) {
    for (int i = 0; i < n; i++) total += C[i] * x[i];
    return total;
}

static double output(const double *C, const double *x, int n) { return sum(0.0, C, x, n); }

/* x = A x + B u */
static void advance(const double *A, const double *B, double u, double *x, int n) {
    double next[NMAX];
    for (int i = 0; i < n; i++) next[i] = sum(B[i] * u, A + i * n, x, n);
    memcpy(x, next, (size_t)n * sizeof *x);
}

static double late(double *line, double samples, double value) {
    if (samples <= 0.0) return value;
    memmove(line + 1, line, (NLINE - 1) * sizeof *line);
    line[0] = value;
    int whole = (int)samples;
    double share = samples - whole;
    return (1.0 - share) * line[whole] + share * line[whole + 1];
}

static double feed_forward(controller *c, double theta_m) {
    double speed = MODEL == MEASURED || MODEL == EXACT ? (theta_m - c->angle) / SAMPLE_TIME : c->m[1];
    c->angle = theta_m;
    return FORWARD[3] * speed - FORWARD[0] * sin(FORWARD[1] * theta_m + FORWARD[2]) - FORWARD[4];
}

/* A new estimate moves the screw behind the motor, and all that follows it; a gap that grows moves nothing. */
static void take_gap(controller *c, double gap) {
    double growth = c->grows > 0.0 ? c->growth : 0.0, estimate = gap > 0.0 ? gap - growth : 0.0;
    if (estimate != c->gap) {
        double gained = c->share * (estimate - c->gap);
        c->gap = estimate;
        c->screw -= gained;
        for (int i = 0; i < NS; i++) c->s[i] -= gained * S_REST[i];
        for (int i = 0; i < NLINE; i++) c->lines[2][i] -= gained * output(SC, S_REST, NS);
        for (int i = 0; i < NW; i++) c->w[i] -= gained * W_REST[i];
    }
    if (growth != 0.0) {
        c->gap = estimate + growth > 0.0 ? estimate + growth : 0.0;
        if (c->gap > 0.0) c->share = clip(c->share * estimate / c->gap, -1.0, 1.0);
    }
}

/* The reference that is let through while the motor crosses the gap, m. */
static double held(controller *c, double r, double gap) {
    double jump = r - c->through;
    if (CROSSING_STEP > 0.0 && gap > SMALL_GAP && fabs(jump) > JUMP) {
        double side = jump > 0.0 ? 1.0 : -1.0, left = (1.0 - c->share * side) * gap;
        c->share += side * (left < CROSSING_STEP ? left : CROSSING_STEP) / gap;
        if (left > CROSSING_STEP) {
            c->waits = ARRIVING + PATIENCE;
            return c->through;
        }
        if (c->waits > 0.0) {
            c->waits -= 1.0;
            if (c->waits > PATIENCE || (c->waits > 0.0 && fabs(c->behind) > NEAR)) return c->through;
        }
    }
    c->through = r;
    c->waits = 0.0;
    return r;
}

/* The motor crosses to the side to which the load will move next. */
static double set_out(controller *c, double r, double gap) {
    if (CROSSING_STEP > 0.0 && gap > 0.0) {
        double left = (1.0 - c->share * c->toward) * gap;
        c->share += c->toward * (left < CROSSING_STEP ? left : CROSSING_STEP) / gap;
    }
    c->through = r;
    c->waits = 0.0;
    return r;
}

static double inverse(controller *c, double r, double error, double gap) {
    double ahead = output(WC, c->w_r, NW) + WD * r;
    advance(&WA[0][0], WB, r, c->w_r, NW);
    double moved = CROSSING_RATIO * (ahead - c->ahead) + CROSSING_RATE * SAMPLE_TIME * error;
    if (c->waits == 0.0) c->share = clip(c->share + moved / (gap > SMALL_GAP ? gap : SMALL_GAP), -1.0, 1.0);
    c->ahead = ahead;
    return c->share * gap;
}

/* What keeps the motor from its model while the reference is held is made up for. */
static void catch_up(controller *c, double apart) {
    if (c->waits == 0.0) {
        c->apart = apart;
        return;
    }
    c->behind = c->apart - apart;
    c->caught = clip(c->caught + CATCHING * c->behind, -CATCHING_MOST, CATCHING_MOST);
}

/* The first of the moves that cost least, by projected fast gradient steps from those of the sample before, V. */
static double planned(controller *c, double forward) {
    double ahead[NP], slope[NP], next[NP], changed = 2.0 * FOUND;
    memcpy(ahead, c->moves, sizeof ahead);
    for (int i = 0; i < NP; i++) slope[i] = output(LF[i], c->law, NL);
    for (int k = 0; k < SEARCH_STEPS && changed >= FOUND; k++) {
        changed = 0.0;
        for (int i = 0; i < NP; i++) next[i] = ahead[i] - SEARCH[0] * (output(LH[i], ahead, NP) + slope[i]);
        for (int i = 0; i < NP; i++) {
            double found = clip(next[i], -LIMIT - forward, LIMIT - forward), by = found - c->moves[i];
            if (fabs(by) > changed) changed = fabs(by);
            ahead[i] = found + SEARCH[1] * by;
            c->moves[i] = found;
        }
    }
    return c->moves[0];
}

static double linear(controller *c, const double y[3], double forward) {
    double u = PREDICTIVE ? planned(c, forward) + forward
                          : clip(output(LC, c->law, NL) + output(LD, y, 3) + forward, -LIMIT, LIMIT);
    double next[NMAX];
    for (int i = 0; i < NL; i++)
        next[i] = output(LA[i], c->law, NL) + output(LB[i], y, 3) + LE[i] * (u - forward);
    memcpy(c->law, next, sizeof c->law);
    return u;
}

static double law(controller *c, double r, double theta_m, double q3) {
    double gap = STRUCTURE == NIMC ? c->half_gap : 0.0;
    double forward = FORWARDS ? feed_forward(c, theta_m) : 0.0;
    if (STRUCTURE == LINEAR) {
        double all[3] = {r, theta_m, q3};
        return linear(c, all, forward);
    }
    if (MODEL == INVERSE) {
        take_gap(c, gap);
        r = c->toward != 0.0 ? set_out(c, r, gap) : held(c, r, gap);
    }
    double error = r - (q3 - late(c->lines[2], LATE[2], output(SC, c->s, NS)));
    double theta_ref = output(WC, c->w, NW) + WD * error;
    advance(&WA[0][0], WB, error, c->w, NW);
    if (MODEL == EXACT) {
        double u = clip(GAIN * (theta_ref - theta_m) + forward, -LIMIT, LIMIT);
        advance(&SA[0][0], SB, late(c->lines[0], LATE[0], u - forward), c->s, NS);
        return u;
    }
    double screw = c->m[2];
    if (!(MODEL == BARE && STRUCTURE == IMC)) {
        if (MODEL != BARE) c->screw = play(c->screw, MODEL == MEASURED ? theta_m : c->m[2], gap);
        screw = c->screw;
    }
    double feedback = theta_m;
    if (MODEL == INVERSE) {
        feedback = theta_m - inverse(c, r, theta_ref - screw, gap) - c->caught;
    } else if (STRUCTURE == NIMC) {
        c->screw_measured = play(c->screw_measured, theta_m, gap);
        feedback = MODEL == INNER_LOOP ? c->screw_measured : screw;
    }
    double u = clip(GAIN * (theta_ref - feedback) + forward, -LIMIT, LIMIT);
    advance(&SA[0][0], SB, screw, c->s, NS);
    if (MODEL == BARE) {
        double z = theta_m - c->screw, omega = c->m[1];
        if (STRUCTURE == NIMC && ((omega > 0.0 && z >= gap) || (omega < 0.0 && z <= -gap)))
            c->screw += omega * SAMPLE_TIME;
        advance(&MA[0][0], MB, late(c->lines[0], LATE[0], u - forward), c->m, NM);
    } else if (MODEL == INNER_LOOP || MODEL == INVERSE) {
        double ahead = MODEL == INVERSE ? c->share * gap : 0.0, own = MODEL == INVERSE ? c->m[2] : screw;
        own = late(c->lines[1], LATE[1], own);
        catch_up(c, theta_m - own);
        double own_u = clip(GAIN * (theta_ref + ahead - own), -LIMIT, LIMIT);
        advance(&MA[0][0], MB, late(c->lines[0], LATE[0], own_u), c->m, NM);
    }
    return u;
}

/* At rest where y is, with y[1] as the reference: the first voltage is what is fed forward, and no bump. */
void controller_reset(controller *c, const double y[2]) {
    double theta_m = fabs(y[0]) <= SANE ? y[0] : 0.0, q3 = fabs(y[1]) <= SANE ? y[1] : 0.0;
    double gap = c->half_gap, whole = output(SC, S_UNIT, NS), left = theta_m - (whole > 0.0 ? q3 / whole : theta_m);
    memset(c, 0, sizeof *c);
    c->good[0] = c->good[2] = q3;
    c->good[1] = c->angle = theta_m;
    c->half_gap = c->gap = gap;
    for (int i = 0; i < NL; i++) c->law[i] = X_REST[i][0] * theta_m + X_REST[i][1] * q3;
    c->share = gap > 0.0 && STRUCTURE == NIMC ? clip(left / gap, -1.0, 1.0) : 0.0;
    double behind = theta_m - c->share * gap, asked = whole * behind, unit = output(WC, W_UNIT, NW);
    c->screw = c->screw_measured = behind;
    c->m[NM - 1] = MODEL == BARE ? behind : theta_m;
    for (int i = 0; i < NS; i++) c->s[i] = S_UNIT[i] * behind;
    for (int i = 0; i < NW; i++) {
        c->w[i] = unit > 0.0 ? W_UNIT[i] * (behind - WD * asked) / unit : 0.0;
        c->w_r[i] = W_UNIT[i] * q3;
    }
    c->ahead = output(WC, c->w_r, NW) + WD * q3;
    c->through = q3;
    for (int i = 0; i < NLINE; i++) {
        c->lines[1][i] = MODEL == INVERSE ? theta_m : behind;
        c->lines[2][i] = asked;
    }
}

/* Before the first step. */
void controller_start(controller *c, const double y[2]) {
    c->half_gap = FIRST_HALF_GAP;
    controller_reset(c, y);
}

/* A new estimate of the half-gap, rad, that goes on growing by `growth`, rad/s, for `seconds`. Returns 0 and changes
   nothing where that is no gap: not finite, below 0, above a turn. */
int controller_set_gap(controller *c, double half_gap, double growth, double seconds) {
    double end = half_gap + growth * seconds;
    if (!(half_gap >= 0.0 && half_gap <= GAP_MOST && seconds >= 0.0 && end >= 0.0 && end <= GAP_MOST)) return 0;
    c->half_gap = half_gap;
    c->growth = growth * SAMPLE_TIME;
    c->grows = floor(seconds / SAMPLE_TIME + 0.5);
    return 1;
}

/* Where the reference is known ahead: to which side (-1, 1; 0: to none) the load moves in `controller_lead` from now. */
void controller_set_out(controller *c, int side) { c->toward = side > 0 ? 1.0 : side < 0 ? -1.0 : 0.0; }

/* How long before the load moves the motor has to set out to cross the gap, s. */
double controller_lead(const controller *c) {
    return CROSSING_STEP > 0.0 ? (ceil(2.0 * c->half_gap / CROSSING_STEP) + ARRIVING) * SAMPLE_TIME : 0.0;
}

/* One sample: reference m, y = (measured angle rad, measured output m); returns the voltage, V, within LIMIT. */
double controller_step(controller *c, double r, const double y[2]) {
    const double now[3] = {r, y[0], y[1]};
    int bad = 0;
    for (int i = 0; i < 3; i++) {
        if (fabs(now[i]) <= SANE)
            c->good[i] = now[i];
        else
            bad = 1;
    }
    double u = law(c, c->good[0], c->good[1], c->good[2]);
    if (c->grows > 0.0) {
        c->half_gap = c->half_gap + c->growth > 0.0 ? c->half_gap + c->growth : 0.0;
        c->grows -= 1.0;
    }
    c->held += (unsigned long)bad;
    return clip(u, -LIMIT, LIMIT);
}
