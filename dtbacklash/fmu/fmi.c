/* The functions of FMI for co-simulation, 2.0 or 3.0 as the macro FMI says, around a slave:
 *
 * Slave, a struct with its Journal `journal` and no pointers but those that bind() sets; anew(s) as instantiated;
 * start(s, t) before the initialization; begin(s) after it; put and show values by their references; move(s, now,
 * seconds). They return a status. */

#if defined(_WIN32)
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

static Slave *born(const char *name, const char *token, Logger log, void *importer)
{
    Journal to = {log, importer, ""};
    Slave *s = NULL;

    snprintf(to.instance, sizeof to.instance, "%s", name ? name : "");
    if (!token || strcmp(token, TOKEN) != 0)
        tell(&to, "the description is that of another FMU: its token is not %s", TOKEN);
    else if (!(s = calloc(1, sizeof *s)))
        tell(&to, "no memory for an instance (%lu bytes)", (unsigned long)sizeof *s);
    if (s) {
        s->journal = to;
        anew(s);
    }
    return s;
}

static int keep(const Slave *s, void **kept)
{
    if (!*kept)
        *kept = malloc(sizeof *s);
    if (*kept)
        memcpy(*kept, s, sizeof *s);
    return *kept ? OK : tell(&s->journal, "no memory for a state");
}

static int bring_back(Slave *s, const void *kept)
{
    Journal own = s->journal;

    memcpy(s, kept, sizeof *s);
    s->journal = own;
    bind(s);
    return OK;
}

static int forget(void **kept)
{
    free(*kept);
    *kept = NULL;
    return OK;
}

static int write_down(const Slave *s, const void *kept, uint8_t *bytes, size_t n)
{
    if (n < sizeof *s)
        return tell(&s->journal, "a state takes %lu bytes", (unsigned long)sizeof *s);
    memcpy(bytes, kept, sizeof *s);
    return OK;
}

static int read_back(const Slave *s, const uint8_t *bytes, size_t n, void **kept)
{
    if (n < sizeof *s)
        return tell(&s->journal, "a state takes %lu bytes", (unsigned long)sizeof *s);
    if (!*kept)
        *kept = malloc(sizeof *s);
    if (*kept)
        memcpy(*kept, bytes, sizeof *s);
    return *kept ? OK : tell(&s->journal, "no memory for a state");
}

/* what the slave does not have: other types of variables, derivatives, events, clocks */
#define HAS_NOT(name) API int name(void) { return WRONG; }
#define DOES_NOTHING(name) API int name(void) { return OK; }
#define IS_NONE(name) API void *name(void) { return NULL; }
/* a state that is kept, brought back, forgotten, and written as bytes: alike in both versions, but for the names */
#define STATES(get, set, drop, size, write, read) \
    API int get(Slave *s, void **kept) { return keep(s, kept); } \
    API int set(Slave *s, void *kept) { return bring_back(s, kept); } \
    API int drop(Slave *s, void **kept) { return (void)s, forget(kept); } \
    API int size(Slave *s, void *kept, size_t *n) { return (void)kept, *n = sizeof *s, OK; } \
    API int write(Slave *s, void *kept, uint8_t *bytes, size_t n) { return write_down(s, kept, bytes, n); } \
    API int read(Slave *s, const uint8_t *bytes, size_t n, void **kept) { return read_back(s, bytes, n, kept); }

#if FMI == 2
API const char *fmi2GetTypesPlatform(void) { return "default"; }
API const char *fmi2GetVersion(void) { return "2.0"; }

/* What the importer gives an instance. */
typedef struct {
    Logger log;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *importer;
} Callbacks;

API void *fmi2Instantiate(const char *name, int type, const char *token, const char *resources, const Callbacks *called)
{
    (void)resources;
    return type == 1 ? born(name, token, called ? called->log : NULL, called ? called->importer : NULL) : NULL;
}
API void fmi2FreeInstance(void *s) { free(s); }
API int fmi2SetupExperiment(Slave *s, int tolerance, double is, double from)
{
    (void)tolerance, (void)is;
    return start(s, from);
}
API int fmi2ExitInitializationMode(Slave *s) { return begin(s); }
API int fmi2Reset(Slave *s) { return anew(s); }
API int fmi2GetReal(Slave *s, const unsigned *which, size_t n, double *values) { return show(s, which, n, values); }
API int fmi2SetReal(Slave *s, const unsigned *which, size_t n, const double *values) { return put(s, which, n, values); }
API int fmi2DoStep(Slave *s, double now, double seconds) { return move(s, now, seconds); }
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
API void *fmi3InstantiateCoSimulation(
    const char *name, const char *token, const char *resources, bool visible, bool logging, bool events, bool early,
    const uint32_t *between, size_t n, void *importer, Logger log)
{
    (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)between, (void)n;
    return born(name, token, log, importer);
}
API void fmi3FreeInstance(void *s) { free(s); }
API int fmi3EnterInitializationMode(Slave *s, bool tolerance, double is, double from)
{
    (void)tolerance, (void)is;
    return start(s, from);
}
API int fmi3ExitInitializationMode(Slave *s) { return begin(s); }
API int fmi3Reset(Slave *s) { return anew(s); }
API int fmi3GetFloat64(Slave *s, const uint32_t *which, size_t n, double *values, size_t m)
{
    return m == n ? show(s, which, n, values) : WRONG;
}
API int fmi3SetFloat64(Slave *s, const uint32_t *which, size_t n, const double *values, size_t m)
{
    return m == n ? put(s, which, n, values) : WRONG;
}
API int fmi3DoStep(Slave *s, double now, double seconds, bool undone, bool *event, bool *ends, bool *early, double *last)
{
    (void)undone;
    *event = *ends = *early = false;
    int status = move(s, now, seconds);
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
