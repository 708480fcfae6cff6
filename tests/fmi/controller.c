/* A unit that says activations of three muscles: 0.1, 0.2 and 0.3 at its start, rising by 0.5 a second. It knows the time by its own steps
   alone. Compiled with -DFMI=2 or -DFMI=3; outputs have the value references 7, 8 and 9. */

#include <stddef.h>

static double started, gone;
static int instances;

static int get(const unsigned *references, size_t n, double *values) {
    for (size_t i = 0; i < n; i++) {
        if (references[i] < 7 || references[i] > 9) return 3;
        values[i] = 0.1 * (references[i] - 6) + 0.5 * gone;
    }
    return 0;
}

static int step(double from, double size) {
    double off = from - started - gone;
    if (size <= 0.0 || off > 1e-9 || off < -1e-9) return 3;
    gone += size;
    return 0;
}

#if FMI == 2
typedef struct { void *log, *allocate, *release, *finished, *environment; } callbacks;
void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources, const callbacks *call, int visible, int logging) {
    (void)name; (void)resources; (void)visible; (void)logging;
    return kind == 1 && guid[0] == '{' && call && call->log && !instances++ ? &instances : NULL;
}
int fmi2SetupExperiment(void *c, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
    (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
    started = start; gone = 0.0;
    return c ? 0 : 3;
}
int fmi2EnterInitializationMode(void *c) { return c ? 0 : 3; }
int fmi2ExitInitializationMode(void *c) { return c ? 0 : 3; }
int fmi2DoStep(void *c, double from, double size, int no_way_back) { (void)c; (void)no_way_back; return step(from, size); }
int fmi2GetReal(void *c, const unsigned *references, size_t n, double *values) { (void)c; return get(references, n, values); }
void fmi2FreeInstance(void *c) { (void)c; instances--; }
#else
#include <stdbool.h>
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging, bool events,
                                  bool early, const unsigned *intermediate, size_t n, void *environment, void *log, void *update) {
    (void)name; (void)visible; (void)logging; (void)early; (void)intermediate; (void)n; (void)environment; (void)update;
    size_t end = 0;
    while (resources[end]) end++;
    bool ends_well = end && (resources[end - 1] == '/' || resources[end - 1] == '\\');
    return token[0] == '{' && log && !events && ends_well && !instances++ ? &instances : NULL;
}
int fmi3EnterInitializationMode(void *c, bool has_tolerance, double tolerance, double start, bool has_stop, double stop) {
    (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
    started = start; gone = 0.0;
    return c ? 0 : 3;
}
int fmi3ExitInitializationMode(void *c) { return c ? 0 : 3; }
int fmi3DoStep(void *c, double from, double size, bool no_way_back, bool *event, bool *ends, bool *early, double *last) {
    (void)c; (void)no_way_back;
    *event = *ends = *early = false;
    int status = step(from, size);
    *last = started + gone;
    return status;
}
int fmi3GetFloat64(void *c, const unsigned *references, size_t n, double *values, size_t n_values) {
    (void)c;
    return n == n_values ? get(references, n, values) : 3;
}
void fmi3FreeInstance(void *c) { (void)c; instances--; }
#endif
