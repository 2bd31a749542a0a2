/* {{title}}
 *
 * Written by kalman_ros export from {{source}}.
 *
 * {{summary}}
 *
 * The state x of the estimator ({{states_in_words}}):
{{states}}
 *
 * The input u ({{inputs_in_words}}):
{{inputs}}
 *
 * The sensors, with what NAME_correct_SENSOR takes; those that read at one time, in this order:
{{sensors}}
 *
 * Call NAME_init once. Then, in this order, in each step of the loop:
 *
 *     NAME_predict(&loop, dt);                 seconds since the last call
 *     NAME_correct_SENSOR(&loop, y, 0);        for each sensor that has a new reading
{{calls}}
 *
 * A function with an outcome returns what became of it. {{worth}} worth a look; a reading
 * that is refused changes nothing but the records. dt of NAME_predict is 0 or more.
{{long}}
 *
 * Nothing is allocated, nothing is recursive, no function waits, and all that changes is in the
 * struct: several loops, or several threads with a loop each, need nothing else.
 */

#ifndef PREFIX_H
#define PREFIX_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef {{real}} NAME_real;

enum { PREFIX_STATES = {{STATES}}, PREFIX_INPUTS = {{INPUTS}}, PREFIX_SENSORS = {{SENSORS}} };

/* Places in x. */
enum {
{{state_places}}
};
{{input_places}}
/* What became of a reading or a step. */
typedef enum {
    PREFIX_FUSED = 0,          /* done */
    PREFIX_RECOVERED = 1,      /* fused, after the covariance was widened: too many rejections */
    PREFIX_REJECTED = 2,       /* outside the gate of its sensor */
    PREFIX_OUTVOTED = 3,       /* outside it, and other sensors agree with the estimate */
    PREFIX_INDEFINITE = 4,     /* the update has no finite positive result */
    PREFIX_NOT_FINITE = 5,     /* a number is not finite: it is not used */
    PREFIX_BAD_COVARIANCE = 6, /* the covariance of the reading is not positive definite */
    PREFIX_DUPLICATE = 7,      /* this sensor was corrected by at this time already */
    PREFIX_RESTARTED = 8,      /* the step has no result, or is too long: the first belief again */
    PREFIX_BAD_TIME = 9,       /* dt is negative or not finite: nothing happened */
    PREFIX_UNREACHABLE = 10    /* no input within its limits holds this reference: nothing changed */
} NAME_outcome;

/* How the readings of a sensor agreed so far. */
typedef struct {
    int64_t time;      /* of the last one, in ns */
    int64_t interval;  /* between the last two, in ns; 0 before the second */
    uint32_t rejections; /* in a row */
    int8_t agrees;     /* 1, 0; -1 where that says nothing */
    int8_t seen;       /* whether there was one */
} NAME_record;

typedef struct {
    NAME_real x[{{STATES}}];            /* the estimate */
    NAME_real P[{{STATES}} * {{STATES}}];       /* its covariance, row by row */
    NAME_real input[{{most_inputs}}];        /* the input that acts */
    NAME_real innovation[{{readings}}];   /* of the last reading: y - what was expected */
    NAME_real S[{{readings}} * {{readings}}]; /* its covariance, row by row without gaps */
    NAME_real nis;                      /* and its normalised square; may be infinite */
    int64_t time;                       /* ns since NAME_init */
    uint32_t restarts, repairs;         /* of the estimate, of covariances lost to rounding */
    NAME_record records[{{SENSORS}}];
{{model_fields}}{{law_fields}}} NAME_loop;

/* The first belief, at time 0, and the idle input{{init}}. */
void NAME_init(NAME_loop *loop);

/* The input u ({{inputs_in_words}}) acts from now on; for who computes it elsewhere{{handed_over}}. */
NAME_outcome NAME_input(NAME_loop *loop, const NAME_real *u);

/* dt seconds pass. */
NAME_outcome NAME_predict(NAME_loop *loop, NAME_real dt);

/* A reading y of a sensor, taken now. R is its covariance, row by row; 0 for the configured one. */
{{corrections}}
{{law_functions}}
#ifdef __cplusplus
}
#endif

#endif
