/* $title
 * The functions of FMI 3.0 for co-simulation around $name.c. Written by `observer export`. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "$name.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

/* Types as the standard has them. */
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } Status;
typedef uint32_t Reference;

typedef struct {
    ${name}_state state;
    ${name}_in in;
    ${name}_out out;
    double start_s;
    double now_s;
    double steps; /* taken since the start */
} Instance;

static double *real_at(Instance *own, Reference reference)
{
$reals    return NULL;
}

static int *int_at(Instance *own, Reference reference)
{
$ints    return NULL;
}

static bool *bool_at(Instance *own, Reference reference)
{
$bools    return NULL;
}

static bool is_input(Reference reference)
{
    return $inputs;
}

static void reset(Instance *own)
{
    memset(own, 0, sizeof *own);
    ${name}_init(&own->state);
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT Status fmi3SetDebugLogging(void *instance, bool on, size_t count, const char *const names[])
{
    (void)instance; (void)on; (void)count; (void)names;
    return OK;
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources,
    bool visible, bool logging, bool events, bool early, const Reference required[], size_t count,
    void *environment, void *log, void *update)
{
    Instance *own;
    (void)name; (void)resources; (void)visible; (void)logging; (void)events; (void)early;
    (void)required; (void)count; (void)environment; (void)log; (void)update;
    if (token == NULL || strcmp(token, "$token") != 0) return NULL;
    own = malloc(sizeof *own);
    if (own != NULL) reset(own);
    return own;
}

EXPORT void fmi3FreeInstance(void *instance) { free(instance); }

EXPORT Status fmi3EnterInitializationMode(void *instance, bool toleranced, double tolerance, double start_s,
    bool stops, double stop_s)
{
    Instance *own = instance;
    (void)toleranced; (void)tolerance; (void)stops; (void)stop_s;
    own->start_s = start_s;
    own->now_s = start_s;
    return OK;
}

EXPORT Status fmi3ExitInitializationMode(void *instance)
{
    Instance *own = instance;
$begin    return OK;
}

EXPORT Status fmi3EnterStepMode(void *instance) { (void)instance; return OK; }
EXPORT Status fmi3EnterEventMode(void *instance) { (void)instance; return OK; }
EXPORT Status fmi3Terminate(void *instance) { (void)instance; return OK; }
EXPORT Status fmi3Reset(void *instance) { reset(instance); return OK; }

/* Steps of $period s as they fall into the communication step; each takes the inputs that were set before. */
EXPORT Status fmi3DoStep(void *instance, double point_s, double size_s, bool no_return, bool *events,
    bool *terminates, bool *early, double *reached_s)
{
    Instance *own = instance;
    double end_s = point_s + size_s;
    (void)no_return;
    *events = false;
    *terminates = false;
    *early = false;
    if (size_s < 0.0) return ERROR;
    while (own->start_s + (own->steps + 1.0) * $period <= end_s + 1e-6 * $period) {
        ${name}_step(&own->state, &own->in, &own->out);
        own->steps += 1.0;
    }
    own->now_s = end_s;
    *reached_s = end_s;
    return OK;
}

#define ACCESS(NAME, TYPE, AT, KIND)                                                                          \
    EXPORT Status fmi3Get##NAME(void *instance, const Reference references[], size_t count, TYPE values[],    \
        size_t size)                                                                                          \
    {                                                                                                         \
        if (size < count) return ERROR;                                                                       \
        for (size_t i = 0; i < count; i++) {                                                                  \
            KIND *at = AT(instance, references[i]);                                                           \
            if (at == NULL) return ERROR;                                                                     \
            values[i] = (TYPE)*at;                                                                            \
        }                                                                                                     \
        return OK;                                                                                            \
    }                                                                                                         \
    EXPORT Status fmi3Set##NAME(void *instance, const Reference references[], size_t count,                   \
        const TYPE values[], size_t size)                                                                     \
    {                                                                                                         \
        if (size < count) return ERROR;                                                                       \
        for (size_t i = 0; i < count; i++) {                                                                  \
            KIND *at = AT(instance, references[i]);                                                           \
            if (at == NULL || !is_input(references[i])) return ERROR;                                         \
            *at = (KIND)values[i];                                                                            \
        }                                                                                                     \
        return OK;                                                                                            \
    }

ACCESS(Float64, double, real_at, double)
ACCESS(Int32, int32_t, int_at, int)
ACCESS(Boolean, bool, bool_at, bool)

EXPORT Status fmi3GetFMUState(void *instance, void **kept)
{
    if (*kept == NULL) *kept = malloc(sizeof(Instance));
    if (*kept == NULL) return ERROR;
    memcpy(*kept, instance, sizeof(Instance));
    return OK;
}

EXPORT Status fmi3SetFMUState(void *instance, void *kept)
{
    memcpy(instance, kept, sizeof(Instance));
    return OK;
}

EXPORT Status fmi3FreeFMUState(void *instance, void **kept)
{
    (void)instance;
    free(*kept);
    *kept = NULL;
    return OK;
}

/* What the model description does not offer is there by name, for tools that look all names up at once. */
#define NOT_OFFERED(NAME) EXPORT Status fmi3##NAME(void) { return ERROR; }
EXPORT void *fmi3InstantiateModelExchange(void) { return NULL; }
EXPORT void *fmi3InstantiateScheduledExecution(void) { return NULL; }
$absent
