/* A chain of soft segments behind valves, as an FMI 2.0 model: model exchange and co-simulation in one.
 *
 * circuit_table.h, written beside this file when a circuit is exported, holds its numbers: SEGMENTS,
 * COEFFICIENTS, STATES_AT_START, PARAMETERS, LOW, HIGH, POLYNOMIAL, TOLERANCE and the Rosenbrock method.
 *
 * One input u [Pa] at the head of the chain. States x = V/V_rest - 1, all smooth: no events.
 * In co-simulation u is held between communication points.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "circuit_table.h"
#include "fmi2Functions.h"

enum { VOLUME, FLOW, TRANSITION, FORWARD, REVERSE, CRACKING, STIFFNESS, KINDS };
/* value references: u, then blocks of SEGMENTS: x, der(x), V, P, Q and the parameters in the order above */
enum { X, DERIVATIVE, RATIO, PRESSURE, FLOW_INTO, FIRST_PARAMETER };

#define REALS (1 + SEGMENTS * (FIRST_PARAMETER + KINDS))
#define MOST_STEPS 1000000

typedef enum { INSTANTIATED, INITIALIZING, RUNNING, ENDED } Phase;

typedef struct {
    Phase phase;
    double time, u, width;
    double x[SEGMENTS];
    double parameter[KINDS][SEGMENTS];
} State;

typedef struct {
    State now;
    fmi2CallbackFunctions callbacks;
    char name[128];
} Model;

static fmi2Status fail(Model *model, const char *text) {
    if (model->callbacks.logger)
        model->callbacks.logger(model->callbacks.componentEnvironment, model->name, fmi2Error, "error", "%s", text);
    return fmi2Error;
}

/* ---- the circuit ---- */

static double pressure(const State *s, int k, double x, double *slope) {
    double inside = x < LOW[k] ? LOW[k] : x > HIGH[k] ? HIGH[k] : x;
    double p = 0.0, rise = 0.0, scale = s->parameter[STIFFNESS][k];
    for (int j = COEFFICIENTS - 1; j >= 0; j--) {
        rise = rise * inside + p;
        p = p * inside + POLYNOMIAL[k][j];
    }
    *slope = scale * rise;
    return scale * (p + rise * (x - inside));
}

static double flow(const State *s, int k, double drop, double *slope) {
    double factor = s->parameter[FLOW][k], d = s->parameter[TRANSITION][k], e = drop, w, root;
    int cracking = s->parameter[CRACKING][k] != 0.0;
    if (cracking)
        e = drop > s->parameter[FORWARD][k]    ? drop - s->parameter[FORWARD][k]
            : drop < -s->parameter[REVERSE][k] ? drop + s->parameter[REVERSE][k]
                                               : 0.0;
    w = e * e + d * d;
    root = sqrt(sqrt(w));
    if (!cracking) {
        *slope = factor * (0.5 * e * e + d * d) / (w * root);
        return factor * e / root;
    }
    *slope = factor * fabs(e) * (2.0 - 1.5 * e * e / w) / (root * root * root);
    return factor * e * fabs(e) / (root * root * root);
}

typedef struct {
    double p[SEGMENTS], p_slope[SEGMENTS], q[SEGMENTS], q_slope[SEGMENTS], rate[SEGMENTS];
} Links;

static void evaluate(const State *s, const double *x, Links *l) {
    double before = s->u;
    for (int k = 0; k < SEGMENTS; k++) {
        l->p[k] = pressure(s, k, x[k], &l->p_slope[k]);
        l->q[k] = flow(s, k, before - l->p[k], &l->q_slope[k]);
        before = l->p[k];
    }
    for (int k = 0; k < SEGMENTS; k++)
        l->rate[k] = (l->q[k] - (k + 1 < SEGMENTS ? l->q[k + 1] : 0.0)) / s->parameter[VOLUME][k];
}

/* Entry (row, column) of the tridiagonal Jacobian of dx/dt. */
static double jacobian(const State *s, const Links *l, int row, int column) {
    double volume = s->parameter[VOLUME][row];
    if (column == row) {
        double onward = row + 1 < SEGMENTS ? l->q_slope[row + 1] : 0.0;
        return -(l->q_slope[row] + onward) * l->p_slope[row] / volume;
    }
    if (column == row - 1) return l->q_slope[row] * l->p_slope[column] / volume;
    if (column == row + 1) return l->q_slope[column] * l->p_slope[column] / volume;
    return 0.0;
}

/* One step of width h with u held; returns the largest error over tolerance and sets `next`. */
static double step(const State *s, double h, double *next) {
    double stage[STAGES][SEGMENTS], lower[SEGMENTS], pivot[SEGMENTS], upper[SEGMENTS], y[SEGMENTS], worst = 0.0;
    Links base, l;
    evaluate(s, s->x, &base);
    for (int k = 0; k < SEGMENTS; k++) {
        double diagonal = 1.0 / (GAMMA * h) - jacobian(s, &base, k, k);
        upper[k] = k + 1 < SEGMENTS ? -jacobian(s, &base, k, k + 1) : 0.0;
        lower[k] = k ? -jacobian(s, &base, k, k - 1) / pivot[k - 1] : 0.0;
        pivot[k] = diagonal - (k ? lower[k] * upper[k - 1] : 0.0);
    }
    for (int i = 0; i < STAGES; i++) {
        double *u = stage[i];
        for (int k = 0; k < SEGMENTS; k++) {
            y[k] = s->x[k];
            u[k] = 0.0;
            for (int j = 0; j < i; j++) {
                y[k] += A[i][j] * stage[j][k];
                u[k] += C[i][j] / h * stage[j][k];
            }
        }
        evaluate(s, y, &l);
        for (int k = 0; k < SEGMENTS; k++) u[k] += l.rate[k];
        for (int k = 1; k < SEGMENTS; k++) u[k] -= lower[k] * u[k - 1];
        for (int k = SEGMENTS - 1; k >= 0; k--)
            u[k] = (u[k] - (k + 1 < SEGMENTS ? upper[k] * u[k + 1] : 0.0)) / pivot[k];
    }
    for (int k = 0; k < SEGMENTS; k++) {
        double size = fabs(1.0 + s->x[k]), error;
        next[k] = y[k] + stage[STAGES - 1][k];
        error = fabs(stage[STAGES - 1][k]) / (TOLERANCE * (size > 1.0 ? size : 1.0));
        if (!(error <= worst)) worst = error;
    }
    return worst;
}

static fmi2Status advance(Model *model, double end) {
    State *s = &model->now;
    double next[SEGMENTS];
    for (int count = 0; s->time < end; count++) {
        double left = end - s->time;
        double h = s->width > 0.0 && 1.01 * s->width < left ? s->width : left;
        double error, factor;
        if (count > MOST_STEPS || h < 1e-15 * fabs(s->time) || h < 1e-250) return fail(model, "the step underflows");
        error = step(s, h, next);
        factor = isfinite(error) ? 0.9 * pow(error > 1e-12 ? error : 1e-12, -1.0 / METHOD_ORDER) : 0.1;
        if (!(error <= 1.0)) {
            s->width = h * (factor > 0.1 ? factor : 0.1);
            continue;
        }
        for (int k = 0; k < SEGMENTS; k++)
            if (!(next[k] > -1.0)) return fail(model, "a segment is empty: its volume ratio would be negative");
        memcpy(s->x, next, sizeof next);
        s->time = h == left ? end : s->time + h;
        factor = h * (factor < 8.0 ? factor : 8.0);
        s->width = h == left && s->width > factor ? s->width : factor;
    }
    return fmi2OK;
}

/* ---- the interface ---- */

#define MODEL(component) ((Model *)(component))

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

static void start(Model *model) {
    memset(&model->now, 0, sizeof model->now);
    memcpy(model->now.x, STATES_AT_START, sizeof model->now.x);
    memcpy(model->now.parameter, PARAMETERS, sizeof model->now.parameter);
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    Model *model;
    (void)type, (void)resources, (void)visible, (void)logging;
    if (!guid || strcmp(guid, GUID) != 0 || !(model = calloc(1, sizeof *model))) return NULL;
    if (callbacks) model->callbacks = *callbacks;
    snprintf(model->name, sizeof model->name, "%s", name ? name : "circuit");
    start(model);
    return model;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_given, fmi2Real tolerance, fmi2Real begin,
                               fmi2Boolean end_given, fmi2Real end) {
    (void)tolerance_given, (void)tolerance, (void)end_given, (void)end;
    MODEL(c)->now.time = begin;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    MODEL(c)->now.phase = INITIALIZING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    State *s = &MODEL(c)->now;
    for (int k = 0; k < SEGMENTS; k++) {
        if (!(s->parameter[VOLUME][k] > 0.0)) return fail(c, "a volume is not positive");
        if (!(s->parameter[FLOW][k] >= 0.0)) return fail(c, "a flow coefficient is negative");
        if (!(s->parameter[TRANSITION][k] > 0.0)) return fail(c, "a transition pressure is not positive");
        if (!(s->parameter[STIFFNESS][k] > 0.0)) return fail(c, "a stiffness factor is not positive");
    }
    s->phase = RUNNING;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) {
    MODEL(c)->now.phase = ENDED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    start(c);
    return fmi2OK;
}

static double value(const State *s, const Links *l, unsigned reference) {
    unsigned kind = (reference - 1) / SEGMENTS, k = (reference - 1) % SEGMENTS;
    if (reference == 0) return s->u;
    switch (kind) {
        case X: return s->x[k];
        case DERIVATIVE: return l->rate[k];
        case RATIO: return 1.0 + s->x[k];
        case PRESSURE: return l->p[k];
        case FLOW_INTO: return l->q[k];
        default: return s->parameter[kind - FIRST_PARAMETER][k];
    }
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference references[], size_t n, fmi2Real values[]) {
    Links l;
    evaluate(&MODEL(c)->now, MODEL(c)->now.x, &l);
    for (size_t i = 0; i < n; i++) {
        if (references[i] >= REALS) return fail(c, "unknown value reference");
        values[i] = value(&MODEL(c)->now, &l, references[i]);
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference references[], size_t n, const fmi2Real values[]) {
    State *s = &MODEL(c)->now;
    for (size_t i = 0; i < n; i++) {
        unsigned kind = (references[i] - 1) / SEGMENTS, k = (references[i] - 1) % SEGMENTS;
        if (references[i] >= REALS || !isfinite(values[i])) return fail(c, "unknown value reference, or no number");
        if (references[i] == 0) s->u = values[i];
        else if (kind == X) s->x[k] = values[i];
        else if (kind >= FIRST_PARAMETER && s->phase < RUNNING) s->parameter[kind - FIRST_PARAMETER][k] = values[i];
        else return fail(c, "this variable cannot be set now");
    }
    return fmi2OK;
}

#define NONE(type)                                                                                            \
    fmi2Status fmi2Get##type(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##type v[]) {       \
        (void)r, (void)v;                                                                                     \
        return n ? fail(c, "there are no variables of type " #type) : fmi2OK;                                 \
    }                                                                                                         \
    fmi2Status fmi2Set##type(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2##type v[]) { \
        (void)r, (void)v;                                                                                     \
        return n ? fail(c, "there are no variables of type " #type) : fmi2OK;                                 \
    }
NONE(Integer)
NONE(Boolean)
NONE(String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!*state && !(*state = malloc(sizeof(State)))) return fail(c, "no memory");
    memcpy(*state, &MODEL(c)->now, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    memcpy(&MODEL(c)->now, state, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)c, (void)state;
    *size = sizeof(State);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    if (size < sizeof(State)) return fail(c, "a state needs more bytes");
    memcpy(bytes, state, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    if (size != sizeof(State)) return fail(c, "this is no state of this model");
    if (!*state && !(*state = malloc(sizeof(State)))) return fail(c, "no memory");
    memcpy(*state, bytes, sizeof(State));
    return fmi2OK;
}

/* Along states and the input, of derivatives and outputs. */
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                        const fmi2ValueReference known[], size_t knowns, const fmi2Real along[],
                                        fmi2Real derivative[]) {
    const State *s = &MODEL(c)->now;
    double x[SEGMENTS] = {0.0}, u = 0.0;
    Links l;
    evaluate(s, s->x, &l);
    for (size_t i = 0; i < knowns; i++) {
        if (known[i] == 0) u = along[i];
        else if (known[i] <= SEGMENTS) x[known[i] - 1] = along[i];
        else return fail(c, "derivatives are along the states and the input");
    }
    for (size_t i = 0; i < unknowns; i++) {
        int kind = ((int)unknown[i] - 1) / SEGMENTS, k = ((int)unknown[i] - 1) % SEGMENTS;
        double sum = 0.0;
        if (unknown[i] < 1 || kind > FLOW_INTO) return fail(c, "derivatives are of states' rates and outputs");
        if (kind == X || kind == RATIO) sum = x[k];
        if (kind == PRESSURE) sum = l.p_slope[k] * x[k];
        if (kind == FLOW_INTO)
            sum = l.q_slope[k] * ((k ? l.p_slope[k - 1] * x[k - 1] : u) - l.p_slope[k] * x[k]);
        if (kind == DERIVATIVE) {
            for (int j = 0; j < SEGMENTS; j++) sum += jacobian(s, &l, k, j) * x[j];
            if (k == 0) sum += l.q_slope[0] * u / s->parameter[VOLUME][0];
        }
        derivative[i] = sum;
    }
    return fmi2OK;
}

/* model exchange */

fmi2Status fmi2EnterEventMode(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { (void)c; return fmi2OK; }

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    (void)c;
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean keeps, fmi2Boolean *event, fmi2Boolean *terminate) {
    (void)c, (void)keeps;
    *event = *terminate = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
    MODEL(c)->now.time = time;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
    if (n != SEGMENTS) return fail(c, "wrong number of states");
    memcpy(MODEL(c)->now.x, x, sizeof MODEL(c)->now.x);
    return fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    if (n != SEGMENTS) return fail(c, "wrong number of states");
    memcpy(x, MODEL(c)->now.x, sizeof MODEL(c)->now.x);
    return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real rate[], size_t n) {
    Links l;
    if (n != SEGMENTS) return fail(c, "wrong number of states");
    evaluate(&MODEL(c)->now, MODEL(c)->now.x, &l);
    memcpy(rate, l.rate, sizeof l.rate);
    return fmi2OK;
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t n) {
    (void)indicators;
    return n ? fail(c, "there are no event indicators") : fmi2OK;
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominal[], size_t n) {
    (void)c;
    for (size_t i = 0; i < n; i++) nominal[i] = 1.0;
    return fmi2OK;
}

/* co-simulation */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real width, fmi2Boolean keeps) {
    (void)keeps;
    if (!(width >= 0.0)) return fail(c, "the communication step is negative");
    MODEL(c)->now.time = time;
    return advance(c, time + width);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
                                       const fmi2Real v[]) {
    (void)r, (void)n, (void)order, (void)v;
    return fail(c, "the input is held between communication points");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real v[]) {
    (void)r, (void)n, (void)order, (void)v;
    return fail(c, "outputs have no derivatives here");
}

fmi2Status fmi2CancelStep(fmi2Component c) { return fail(c, "steps are not asynchronous"); }

#define STATUS(suffix, type)                                                                \
    fmi2Status fmi2Get##suffix(fmi2Component c, const fmi2StatusKind kind, type *v) {       \
        (void)kind, (void)v;                                                                \
        return fail(c, "steps are not asynchronous");                                       \
    }
STATUS(Status, fmi2Status)
STATUS(RealStatus, fmi2Real)
STATUS(IntegerStatus, fmi2Integer)
STATUS(BooleanStatus, fmi2Boolean)
STATUS(StringStatus, fmi2String)
