/* Replays vectors.txt, which Python recorded, and compares. Written by kalman_ros export. */

#include "NAME.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define N {{STATES}}
#define M {{INPUTS}}
#define LONGEST ({{readings}} * ({{readings}} + 1) + N + M + 1)

/* Differences are relative to the largest magnitude of each number in the recording. */
static const double ALLOWED = sizeof(NAME_real) == sizeof(double) ? {{allowed}} : {{allowed_float}};
static double largest_difference, scales[2 * N + M + 1];
static const int SIZES[] = {{{sizes}}};
static long calls;
static NAME_real last[PREFIX_SENSORS][{{readings}}];

static double number(FILE *file)
{
    char word[64];
    if (fscanf(file, "%63s", word) != 1) {
        fprintf(stderr, "check: vectors.txt ends too early\n");
        exit(2);
    }
    return strtod(word, 0);
}

static int whole(FILE *file) { return (int)number(file); }

/* Where numbers differ by more than is allowed, say so once. */
static int differs(double found, double expected, double scale, const char *what, int at)
{
    double difference = fabs(found - expected) / (scale > 0 ? scale : 1);
    if (difference > largest_difference)
        largest_difference = difference;
    if (difference <= ALLOWED)
        return 0;
    fprintf(stderr, "check: FAIL: call %ld: %s[%d] is %.17g, expected %.17g\n", calls, what, at, found,
            expected);
    return 1;
}

static const char *named(int outcome)
{
    static const char *const OUTCOMES[] = {
        "FUSED", "RECOVERED", "REJECTED", "OUTVOTED", "INDEFINITE", "NOT_FINITE", "BAD_COVARIANCE",
        "DUPLICATE", "RESTARTED", "BAD_TIME", "UNREACHABLE"};
    return outcome >= 0 && outcome < 11 ? OUTCOMES[outcome] : "unknown";
}

static NAME_outcome correct(NAME_loop *loop, int index, const NAME_real *y, const NAME_real *R)
{
    switch (index) {
{{cases}}
    default: return PREFIX_BAD_TIME;
    }
}

#ifdef COUNT
/* Operations of a step in which every sensor reads. */
static unsigned long long counted_step(const NAME_loop *end)
{
    static NAME_loop loop;
    NAME_real u[M + 1] = {0};
    loop = *end;
    operations = 0;
    NAME_predict(&loop, (NAME_real){{dt}});
    for (int index = 0; index < PREFIX_SENSORS; index++)
        correct(&loop, index, last[index], 0);
{{control}}
    (void)u;
    return operations;
}
#endif

/* Microseconds of a step in which every sensor reads, of the best of some batches of steps. */
static double step(const NAME_loop *end)
{
    static NAME_loop loop;
    enum { BATCHES = 20, STEPS = 200 };
    NAME_real u[M + 1] = {0};
    double best = 1e9;
    for (int batch = 0; batch < BATCHES; batch++) {
        const clock_t start = clock();
        for (int k = 0; k < STEPS; k++) {
            loop = *end;
            NAME_predict(&loop, (NAME_real){{dt}});
            for (int index = 0; index < PREFIX_SENSORS; index++)
                correct(&loop, index, last[index], 0);
{{control}}
        }
        const double took = (double)(clock() - start) / CLOCKS_PER_SEC / STEPS * 1e6;
        best = took < best ? took : best;
    }
    (void)u;
    return best;
}

int main(int argc, char **argv)
{
    FILE *file = fopen(argc > 1 ? argv[1] : "vectors.txt", "r");
    static NAME_loop loop;
    NAME_real given[LONGEST], u[M + 1] = {0};
    if (!file) {
        fprintf(stderr, "check: vectors.txt cannot be read\n");
        return 2;
    }
    for (int i = 0; i < 2 * N + M; i++)
        scales[i] = number(file);
    NAME_init(&loop);
    for (calls = 1;; calls++) {
        char call = 0;
        if (fscanf(file, " %c", &call) != 1 || call == 'E')
            break;
        int index = whole(file), count = whole(file), wrong = 0;
        if (count < 0 || count > LONGEST) {
            fprintf(stderr, "check: vectors.txt is not one of this loop\n");
            return 2;
        }
        for (int i = 0; i < count; i++)
            given[i] = (NAME_real)number(file);
        NAME_outcome outcome = PREFIX_FUSED;
        switch (call) {
        case 'P': outcome = NAME_predict(&loop, given[0]); break;
        case 'I': outcome = NAME_input(&loop, given); break;
        case 'C':
            if (index < 0 || index >= PREFIX_SENSORS)
                return 2;
            outcome = correct(&loop, index, given, count > SIZES[index] ? given + SIZES[index] : 0);
            for (int i = 0; i < SIZES[index] && outcome == PREFIX_FUSED; i++)
                last[index][i] = given[i];
            break;
{{law_cases}}
        default: fprintf(stderr, "check: no call %c\n", call); return 2;
        }
        int expected = whole(file);
        if ((int)outcome != expected) {
            fprintf(stderr, "check: FAIL: call %ld, %c %d: the outcome is %s, expected %s\n", calls,
                    call, index, named((int)outcome), named(expected));
            return 1;
        }
        for (int i = 0; i < N; i++)
            wrong |= differs((double)loop.x[i], number(file), scales[i], "x", i);
        for (int i = 0; i < N; i++)
            wrong |= differs(sqrt((double)loop.P[i * N + i]), number(file), scales[N + i],
                             "deviation", i);
        for (int j = 0; j < M; j++)
            wrong |= differs((double)loop.input[j], number(file), scales[2 * N + j], "u", j);
        if (wrong)
            return 1;
    }
    fclose(file);
    (void)u;
#ifdef COUNT
    printf("check: a step takes %llu operations\n", counted_step(&loop));
    return 0;
#endif
    printf("check: the struct has %zu bytes; a step in which every sensor reads takes %.3f us\n",
           sizeof loop, step(&loop));
    printf("check: PASS: %ld calls, largest difference %.1e (allowed %.0e)\n", calls - 1,
           largest_difference, ALLOWED);
    return 0;
}
