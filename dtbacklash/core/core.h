/* Small functions that all files of the core share; they are inlined everywhere. */
#ifndef DTB_CORE_H
#define DTB_CORE_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "arithmetic.h"
#include "laws.h"
#include "plant.h"
#include "twin.h"
#include "control.h"
#include "loop.h"
#include "adaptation.h"
#include "external.h"

/* ---- the matrices of one gear mode, and of one length of the step ---- */

static inline const double *transition(const Plant *P, int contact, int level)
{
    return P->E + (contact * P->levels + level) * P->n * P->n;
}

static inline const double *held_response(const Plant *P, int contact, int level)
{
    return P->P1 + (contact * P->levels + level) * P->channels * P->n;
}

static inline const double *rising_response(const Plant *P, int contact, int level)
{
    return P->P2 + (contact * P->levels + level) * P->channels * P->n;
}

/* Row of G: what a channel adds to x', in one gear mode. */
static inline const double *effect_of(const Plant *P, int contact, int64_t channel)
{
    return P->G + (contact * P->channels + channel) * P->n;
}

/* ---- the laws at a place ---- */

/* Place j of a slot; its laws are those from first_law() to end_of_laws(). */
static inline int64_t place_of(const Plant *P, int slot, int64_t j) { return P->slot[slot] + j; }
static inline const Law *first_law(const Plant *P, int64_t place) { return P->law + P->first[place]; }
static inline const Law *end_of_laws(const Plant *P, int64_t place) { return P->law + P->first[place + 1]; }

/* Whether any law stands in a slot. */
static inline int acts(const Plant *P, int slot) { return P->acts >> slot & 1; }

double dtb_formula(const Formula *formula, const double *at, const double *p);

/* A call of the law's function of this number, in its slot: a compiled one, or a formula. */
#define LAW_CALL(name, Slot, number)                                                       \
    static inline double name(const Law *law, Slot at)                                     \
    {                                                                                      \
        if (law->formula[number])                                                          \
            return dtb_formula(law->formula[number], (const double *)&at, law->p);         \
        return ((double (*)(const Slot *, const double *))law->call[number])(&at, law->p); \
    }

LAW_CALL(body_effort, BodyEffort, 0)
LAW_CALL(remembered_effort, BodyMemory, 0)
LAW_CALL(memory_rate, BodyMemory, 1)
LAW_CALL(friction_of, Contact, 0)
LAW_CALL(spring_force, SpringForce, 0)
LAW_CALL(spring_stretch, SpringPlay, 0)
LAW_CALL(memory_after, SpringMemory, 0)
LAW_CALL(memory_force, SpringMemory, 1)
LAW_CALL(amplified_command, Command, 0)
LAW_CALL(winding_rate, WindingMemory, 0)
LAW_CALL(winding_voltage, WindingMemory, 1)
LAW_CALL(motor_torque, MotorTorque, 0)
LAW_CALL(lead_error, Lead, 0)
LAW_CALL(lead_slope, Lead, 1)
LAW_CALL(shown, Reading, 0)

#endif
