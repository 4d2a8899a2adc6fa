/* The laws of the effects that come with the package, by slot. */
#include "core.h"

/* ---- helpers of several laws ---- */

/* amplitude sin(wave_number position + phase): cogging, the ripple of a torque or of a lead. */
static double sine(double position, double amplitude, double wave_number, double phase)
{
    return amplitude * sin(wave_number * position + phase);
}

enum { KNOTS = 16 };

/* The table `row` (its values, then the states of its knots) at a state; Catmull & Rom (1974) between the knots. */
static double interpolate(double state, const double *row)
{
    const double *f = row, *x = row + KNOTS;
    int k = 0, end = KNOTS - 1;

    if (!(state > x[0]))
        return f[0];
    if (!(state < x[KNOTS - 1]))
        return f[KNOTS - 1];
    while (end - k > 1) {
        int middle = (k + end) / 2;
        if (state < x[middle])
            end = middle;
        else
            k = middle;
    }
    double wide = x[k + 1] - x[k], rise = f[k + 1] - f[k], first = rise, last = rise;
    if (k > 0) {
        double before = x[k] - x[k - 1];
        first = wide * (wide * (f[k] - f[k - 1]) / before + before * rise / wide) / (before + wide);
    }
    if (k < KNOTS - 2) {
        double after = x[k + 2] - x[k + 1];
        last = wide * (after * rise / wide + wide * (f[k + 2] - f[k + 1]) / after) / (wide + after);
    }
    double w = (state - x[k]) / wide;
    return f[k] + w * (first + w * (3.0 * rise - 2.0 * first - last + w * (first + last - 2.0 * rise)));
}

/* F (KNOTS, N) : what each value of a table over knots (KNOTS,) adds at N states. */
void dtb_table_weights(int64_t N, const double *states, const double *knots, double *F)
{
    double row[2 * KNOTS];

    copy(knots, row + KNOTS, KNOTS);
    for (int64_t j = 0; j < KNOTS; j++) {
        set_zero(row, KNOTS);
        row[j] = 1.0;
        for (int64_t k = 0; k < N; k++)
            F[j * N + k] = interpolate(states[k], row);
    }
}

/* F (N,) : force of a hidden mass on a damped spring, N, along the acceleration (N,) of the body that carries it.
 *
 * frequency : its own, rad/s. step : between samples, s. By Tustin's rule: Franklin, Powell, Workman, Digital Control
 * of Dynamic Systems (1998), section 6.1. */
void dtb_absorber(int64_t N, double mass, double frequency, double damping_ratio, double step,
                  const double *acceleration, double *F)
{
    double c = 2.0 / step, w = frequency, twice = 2.0 * damping_ratio * w, a0 = c * c + c * twice + w * w;
    double a1 = 2.0 * (w * w - c * c) / a0, a2 = (c * c - c * twice + w * w) / a0;
    double b0 = (c * twice + w * w) / a0, b1 = 2.0 * w * w / a0, b2 = (w * w - c * twice) / a0;
    double first = 0.0, second = 0.0;

    for (int64_t k = 0; k < N; k++) {
        double x = acceleration[k], y = b0 * x + first;
        first = b1 * x - a1 * y + second;
        second = b2 * x - a2 * y;
        F[k] = -mass * y;
    }
}

/* ---- efforts on a body, N or N m ---- */

/* What friction that differs between directions has beside its mean. */
double asymmetric_friction(const BodyEffort *at, const double *p)
{
    double viscous_difference = p[0], coulomb_difference = p[1];
    return -(coulomb_difference + viscous_difference * fabs(at->velocity));
}

/* What a body in a fluid loses that is faster than it can creep: -c v |v|. */
double quadratic_drag(const BodyEffort *at, const double *p)
{
    double coefficient = p[0];
    return -coefficient * at->velocity * fabs(at->velocity);
}

/* Braking that a drive gives up as it lets a body coast: all of it without a command, none from one on. */
double coasting(const BodyEffort *at, const double *p)
{
    double coefficient = p[0], driven_from = p[1], u = fabs(at->command);
    return u < driven_from || u == 0.0 ? coefficient * at->velocity * (u == 0.0 ? 1.0 : 1.0 - u / driven_from) : 0.0;
}

/* A load that never changes. */
double constant(const BodyEffort *at, const double *p)
{
    double effort = p[0];
    (void)at;
    return effort;
}

/* Torque of an off-centre mass, m g l sin(angle + phase). rad -> N m. */
double gravity(const BodyEffort *at, const double *p)
{
    double torque = p[0], phase = p[1];
    return torque * sin(at->position + phase);
}

/* A ripple over the position: cogging. */
double periodic(const BodyEffort *at, const double *p)
{
    double amplitude = p[0], wave_number = p[1], phase = p[2];
    return sine(at->position, amplitude, wave_number, phase);
}

/* An effort over the speed of a body. */
double over_speed(const BodyEffort *at, const double *row) { return interpolate(at->velocity, row); }

/* An effort over the position of a body. */
double over_position(const BodyEffort *at, const double *row) { return interpolate(at->position, row); }

/* A damping that depends on the position of a body, times its speed. */
double damping_over_position(const BodyEffort *at, const double *row)
{
    return interpolate(at->position, row) * at->velocity;
}

/* ---- levels of dry friction, N or N m ---- */

/* Dry friction's magnitude. */
double coulomb(const Contact *at, const double *p)
{
    double level = p[0];
    (void)at;
    return level;
}

/* What dry friction has more at rest: level exp(-(slip_speed/speed)^2). */
double stribeck(const Contact *at, const double *p)
{
    double level = p[0], speed = p[1], ratio = at->slip_speed / speed;
    return level * exp(-ratio * ratio);
}

/* Level of a dry friction that grows with the effort that is passed on. */
double loss(const Contact *at, const double *p)
{
    double share = p[0];
    return share * fabs(at->load);
}

/* ---- forces of a spring, N or N m ---- */

/* Force of a hardening (k3 > 0) or softening spring: k3 stretch^3. */
double cubic_stiffness(const SpringForce *at, const double *p)
{
    double k3 = p[0];
    return k3 * at->stretch * at->stretch * at->stretch;
}

/* Force of a turbulent damper: c2 |rate| rate. */
double quadratic_damping(const SpringForce *at, const double *p)
{
    double c2 = p[0];
    return c2 * fabs(at->stretch_rate) * at->stretch_rate;
}

/* Force of a one-sided elastic stop that touches at stretch = clearance. */
double bumper(const SpringForce *at, const double *p)
{
    double stiffness = p[0], clearance = p[1];
    return at->stretch > clearance ? stiffness * (at->stretch - clearance) : 0.0;
}

/* Force that a linear spring gains when its stiffness drifts as k (1 + rate t). */
double stiffness_drift(const SpringForce *at, const double *p)
{
    double rate = p[0];
    return at->spring_stiffness * rate * at->time * at->stretch;
}

/* A spring's effort over its stretch. */
double over_stretch(const SpringForce *at, const double *row) { return interpolate(at->stretch, row); }

/* A spring's effort over the rate of its stretch. */
double over_stretch_rate(const SpringForce *at, const double *row) { return interpolate(at->stretch_rate, row); }

/* A damping that depends on the stretch of a spring, times its rate. */
double damping_over_stretch(const SpringForce *at, const double *row)
{
    return interpolate(at->stretch, row) * at->stretch_rate;
}

/* A stiffness that depends on the rate of a spring's stretch, times the stretch. */
double stiffness_over_rate(const SpringForce *at, const double *row)
{
    return interpolate(at->stretch_rate, row) * at->stretch;
}

/* What is left of a stretch behind a play that springs back to its middle. m -> m. */
double lost_motion(const SpringPlay *at, const double *p)
{
    double total = p[0];
    return play(0.0, at->stretch, 0.5 * total);
}

/* The hysteretic variable after a change of the stretch; Bouc (1967), Wen (1976), n = 1, solved for a stretch that
 * grows. 1. */
double bouc_wen_after(const SpringMemory *at, const double *p)
{
    double displacement = p[1];
    double side = at->change >= 0.0 ? 1.0 : -1.0;
    double z = side * at->memory, far = fabs(at->change) / displacement, free = dmin(far, dmax(-z, 0.0));
    z += free;
    return side * (z + (z - 1.0) * expm1(free - far));
}

/* Force of the hysteretic variable. 1 -> N. */
double bouc_wen_force(const SpringMemory *at, const double *p)
{
    double size = p[0];
    return size * at->memory;
}

/* ---- what the amplifier makes of the command, V ---- */

/* Voltage of an amplifier whose gain errs by `relative`. */
double amplified(const Command *at, const double *p)
{
    double relative = p[0];
    return (1.0 + relative) * at->command;
}

/* Voltage behind a dead zone. */
double dead_zone(const Command *at, const double *p)
{
    double half_width = p[0];
    if (at->command > half_width)
        return at->command - half_width;
    return at->command < -half_width ? at->command + half_width : 0.0;
}

/* Voltage clipped to [-limit, limit]. */
double saturation(const Command *at, const double *p)
{
    double limit = p[0];
    return dmin(dmax(at->command, -limit), limit);
}

/* The command with a voltage over it added. */
double beside_command(const Command *at, const double *row) { return at->command + interpolate(at->command, row); }

/* ---- the winding and the motor ---- */

/* Rate of the relative rise of a winding's resistance beside its decay, 1/s. */
double heating_rate(const WindingMemory *at, const double *p)
{
    double gain = p[0], time_constant = p[1];
    return gain * at->resistance * at->current * at->current / time_constant;
}

/* Voltage that the risen part of a winding's resistance eats, V. */
double voltage_of_heat(const WindingMemory *at, const double *p)
{
    (void)p;
    return at->resistance * at->memory * at->current;
}

/* Torque beside torque_constant current of a motor whose constant ripples with its angle, N m. */
double ripple_torque(const MotorTorque *at, const double *p)
{
    double relative = p[0], periods = p[1], phase = p[2];
    return at->torque_constant * at->current * sine(at->position, relative, periods, phase);
}

/* ---- the screw ---- */

/* Displacement beyond the lead, zero at zero, m. */
double pitch_error(const Lead *at, const double *p)
{
    double amplitude = p[0], periods = p[1], phase = p[2];
    return sine(at->angle, amplitude, periods, phase) - sine(0.0, amplitude, periods, phase);
}

/* Derivative of pitch_error by the angle, m/rad. */
double pitch_slope(const Lead *at, const double *p)
{
    double amplitude = p[0], periods = p[1], phase = p[2];
    return amplitude * periods * cos(periods * at->angle + phase);
}

/* ---- what a sensor shows, in its unit ---- */

/* What a sensor shows whose gain errs by `relative`. */
double scaled(const Reading *at, const double *p)
{
    double relative = p[0];
    return (1.0 + relative) * at->reading;
}

/* What a sensor shows that is off by `offset`. */
double shifted(const Reading *at, const double *p)
{
    double offset = p[0];
    return at->reading + offset;
}

/* What an encoder shows whose disk is off centre: an error once a turn, right at zero. */
double eccentric(const Reading *at, const double *p)
{
    double amplitude = p[0], phase = p[1];
    return at->reading + amplitude * (sin(at->reading + phase) - sin(phase));
}
