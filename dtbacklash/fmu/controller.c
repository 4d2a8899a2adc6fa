/* The controller above as an FMU for co-simulation, of FMI 2.0 or 3.0 as the macro FMI says. The voltage is that of the
   values that are set now; a step takes it, and moves on by whole samples. */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#if defined(_WIN32)
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

enum { REFERENCE, ANGLE, OUTPUT, HALF_GAP, VOLTAGE, HELD, TIME }; /* value references */
enum { OK = 0, WRONG = 3 };

typedef struct {
    controller c;
    double in[HALF_GAP + 1], time;
    int begun;
} slave;

static void at_rest(slave *s) { controller_reset(&s->c, s->in + ANGLE); }

static int anew(slave *s) {
    memset(s, 0, sizeof *s);
    s->in[HALF_GAP] = s->c.half_gap = FIRST_HALF_GAP;
    return OK;
}

static void *born(const char *token) {
    slave *s = token && strcmp(token, TOKEN) == 0 ? malloc(sizeof *s) : NULL;
    if (s) anew(s);
    return s;
}

static int put(slave *s, const unsigned *which, size_t n, const double *values) {
    for (size_t i = 0; i < n; i++) {
        if (which[i] > HALF_GAP) return WRONG;
        if (which[i] == HALF_GAP && !controller_set_gap(&s->c, values[i], 0.0, 0.0)) return WRONG;
        s->in[which[i]] = values[i];
    }
    return OK;
}

static int show(slave *s, const unsigned *which, size_t n, double *values) {
    for (size_t i = 0; i < n; i++) {
        slave now = *s;
        if (which[i] > TIME) return WRONG;
        if (!now.begun) at_rest(&now);
        values[i] = which[i] == VOLTAGE ? controller_step(&now.c, now.in[REFERENCE], now.in + ANGLE)
                    : which[i] == HELD  ? (double)now.c.held
                    : which[i] == TIME  ? now.time
                                        : now.in[which[i]];
    }
    return OK;
}

static int begin(slave *s) {
    at_rest(s);
    s->begun = 1;
    return OK;
}

static int move(slave *s, double seconds) {
    double samples = floor(seconds / SAMPLE_TIME + 0.5);
    if (!(samples >= 1.0 && fabs(seconds / SAMPLE_TIME - samples) < 1e-6 * samples)) return WRONG;
    for (double k = 0.0; k < samples; k++) controller_step(&s->c, s->in[REFERENCE], s->in + ANGLE);
    s->time += seconds;
    return OK;
}

static int keep(const slave *s, void **kept) {
    if (!*kept) *kept = malloc(sizeof *s);
    if (*kept) memcpy(*kept, s, sizeof *s);
    return *kept ? OK : WRONG;
}

static int bring_back(slave *s, const void *kept) { return memcpy(s, kept, sizeof *s) ? OK : WRONG; }

static int forget(void **kept) {
    free(*kept);
    *kept = NULL;
    return OK;
}

static int write_down(const void *kept, uint8_t *bytes, size_t n) {
    return n >= sizeof(slave) && memcpy(bytes, kept, sizeof(slave)) ? OK : WRONG;
}

static int read_back(const uint8_t *bytes, size_t n, void **kept) {
    return n >= sizeof(slave) ? keep((const slave *)(const void *)bytes, kept) : WRONG;
}

/* what a controller does not have: other types of variables, derivatives, events, clocks */
#define HAS_NOT(name) API int name(void) { return WRONG; }
#define DOES_NOTHING(name) API int name(void) { return OK; }
#define IS_NONE(name) API void *name(void) { return NULL; }
/* a state that is kept, brought back, forgotten, and written as bytes: alike in both versions, but for the names */
#define STATES(get, set, drop, size, write, read) \
    API int get(slave *s, void **kept) { return keep(s, kept); } \
    API int set(slave *s, void *kept) { return bring_back(s, kept); } \
    API int drop(slave *s, void **kept) { return (void)s, forget(kept); } \
    API int size(slave *s, void *kept, size_t *n) { return (void)kept, *n = sizeof *s, OK; } \
    API int write(slave *s, void *kept, uint8_t *bytes, size_t n) { return (void)s, write_down(kept, bytes, n); } \
    API int read(slave *s, const uint8_t *bytes, size_t n, void **kept) { return (void)s, read_back(bytes, n, kept); }

#if FMI == 2
API const char *fmi2GetTypesPlatform(void) { return "default"; }
API const char *fmi2GetVersion(void) { return "2.0"; }
API void *fmi2Instantiate(const char *name, int type, const char *token) { return name && type == 1 ? born(token) : NULL; }
API void fmi2FreeInstance(void *s) { free(s); }
API int fmi2SetupExperiment(slave *s, int tolerance, double is, double start) {
    (void)tolerance, (void)is;
    s->time = start;
    return OK;
}
API int fmi2ExitInitializationMode(slave *s) { return begin(s); }
API int fmi2Reset(slave *s) { return anew(s); }
API int fmi2GetReal(slave *s, const unsigned *which, size_t n, double *values) { return show(s, which, n, values); }
API int fmi2SetReal(slave *s, const unsigned *which, size_t n, const double *values) { return put(s, which, n, values); }
API int fmi2DoStep(slave *s, double now, double seconds) { return (void)now, move(s, seconds); }
STATES(fmi2GetFMUstate, fmi2SetFMUstate, fmi2FreeFMUstate, fmi2SerializedFMUstateSize, fmi2SerializeFMUstate,
       fmi2DeSerializeFMUstate)
DOES_NOTHING(fmi2SetDebugLogging) DOES_NOTHING(fmi2EnterInitializationMode) DOES_NOTHING(fmi2Terminate)
HAS_NOT(fmi2GetInteger) HAS_NOT(fmi2SetInteger) HAS_NOT(fmi2GetBoolean) HAS_NOT(fmi2SetBoolean)
HAS_NOT(fmi2GetString) HAS_NOT(fmi2SetString) HAS_NOT(fmi2GetDirectionalDerivative)
HAS_NOT(fmi2SetRealInputDerivatives) HAS_NOT(fmi2GetRealOutputDerivatives) HAS_NOT(fmi2CancelStep)
HAS_NOT(fmi2GetStatus) HAS_NOT(fmi2GetRealStatus) HAS_NOT(fmi2GetIntegerStatus)
HAS_NOT(fmi2GetBooleanStatus) HAS_NOT(fmi2GetStringStatus)
#else
API const char *fmi3GetVersion(void) { return "3.0"; }
API void *fmi3InstantiateCoSimulation(const char *name, const char *token) { return name ? born(token) : NULL; }
API void fmi3FreeInstance(void *s) { free(s); }
API int fmi3EnterInitializationMode(slave *s, bool tolerance, double is, double start) {
    (void)tolerance, (void)is;
    s->time = start;
    return OK;
}
API int fmi3ExitInitializationMode(slave *s) { return begin(s); }
API int fmi3Reset(slave *s) { return anew(s); }
API int fmi3GetFloat64(slave *s, const uint32_t *which, size_t n, double *values, size_t m) {
    return m == n ? show(s, which, n, values) : WRONG;
}
API int fmi3SetFloat64(slave *s, const uint32_t *which, size_t n, const double *values, size_t m) {
    return m == n ? put(s, which, n, values) : WRONG;
}
API int fmi3DoStep(slave *s, double now, double seconds, bool undone, bool *event, bool *ends, bool *early, double *last) {
    (void)undone;
    *event = *ends = *early = false;
    int status = move(s, seconds);
    *last = status == OK ? now + seconds : now;
    return status;
}
STATES(fmi3GetFMUState, fmi3SetFMUState, fmi3FreeFMUState, fmi3SerializedFMUStateSize, fmi3SerializeFMUState,
       fmi3DeserializeFMUState)
DOES_NOTHING(fmi3SetDebugLogging) DOES_NOTHING(fmi3Terminate) DOES_NOTHING(fmi3EnterConfigurationMode)
DOES_NOTHING(fmi3ExitConfigurationMode) DOES_NOTHING(fmi3EnterStepMode)
IS_NONE(fmi3InstantiateModelExchange) IS_NONE(fmi3InstantiateScheduledExecution)
#define TYPE(T) HAS_NOT(fmi3Get##T) HAS_NOT(fmi3Set##T)
TYPE(Float32) TYPE(Int8) TYPE(UInt8) TYPE(Int16) TYPE(UInt16) TYPE(Int32) TYPE(UInt32) TYPE(Int64) TYPE(UInt64)
TYPE(Boolean) TYPE(String) TYPE(Binary) TYPE(Clock) TYPE(IntervalDecimal) TYPE(IntervalFraction) TYPE(ShiftDecimal)
TYPE(ShiftFraction) TYPE(ContinuousStates)
HAS_NOT(fmi3EnterEventMode) HAS_NOT(fmi3GetNumberOfVariableDependencies) HAS_NOT(fmi3GetVariableDependencies)
HAS_NOT(fmi3GetDirectionalDerivative) HAS_NOT(fmi3GetAdjointDerivative) HAS_NOT(fmi3EvaluateDiscreteStates)
HAS_NOT(fmi3UpdateDiscreteStates) HAS_NOT(fmi3EnterContinuousTimeMode) HAS_NOT(fmi3CompletedIntegratorStep)
HAS_NOT(fmi3SetTime) HAS_NOT(fmi3GetContinuousStateDerivatives) HAS_NOT(fmi3GetEventIndicators)
HAS_NOT(fmi3GetNominalsOfContinuousStates) HAS_NOT(fmi3GetNumberOfEventIndicators)
HAS_NOT(fmi3GetNumberOfContinuousStates) HAS_NOT(fmi3GetOutputDerivatives) HAS_NOT(fmi3ActivateModelPartition)
#endif
