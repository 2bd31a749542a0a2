/* What Python calls: a prediction and a correction of a belief, without time and gates. v holds x and
 * P, and behind them what each takes, and receives the results. 1 is returned where that fails, 0
 * where the belief is definite, and otherwise 2.
 */

/* 0 for a belief that is hardly positive definite, or so large that its square is not finite, which
 * is to be looked at more closely */
FAST static int definite(const real *x, const real *P)
{
    real U[N * N];
    for (int i = 0; i < N; i++)
        if (!(fabs(x[i]) < (real)1e150 && P[i * N + i] < (real)1e150))
            return 0;
    if (!factored(P, N, 0, U))
        return 0;
    for (int i = 0; i < N; i++)
        if (!(U[i * N + i] * U[i * N + i] > (real)1e-10 * P[i * N + i]))
            return 0;
    return 1;
}

/* behind P: the input */
int filter_predict(loop_state *s, real *v, real dt)
{
    for (int j = 0; j < M; j++)
        s->input[j] = v[N + N * N + j];
    if (!predicted(s, dt, v, v + N))
        return 1;
    return definite(v, v + N) ? 0 : 2;
}

/* as many beliefs, one behind the other; those without a finite result become NaN */
void filter_predict_many(loop_state *s, real *v, long count, real dt)
{
    for (long i = 0; i < count; i++, v += N + N * N + M)
        if (filter_predict(s, v, dt) == 1)
            for (int j = 0; j < N + N * N; j++)
                v[j] = (real)NAN;
}

/* behind P: y and its covariance R; results are x, P, the innovation, its covariance and the NIS */
int filter_correct(real *v, int index)
{
    const int k = SENSOR[index].size;
    const real *y = v + N + N * N;
    correction c;
    if (!corrected(v, v + N, SENSOR + index, y, y + k, &c))
        return 1;
    memcpy(v, c.x, sizeof c.x);
    memcpy(v + N, c.P, sizeof c.P);
    memcpy(v + N + N * N, c.innovation, (size_t)k * sizeof *v);
    memcpy(v + N + N * N + k, c.S, (size_t)(k * k) * sizeof *v);
    v[N + N * N + k + k * k] = c.nis;
    return definite(v, v + N) ? 0 : 2;
}

void filter_correct_many(real *v, long count, int index)
{
    const int k = SENSOR[index].size, width = N + N * N + k + k * k + 1;
    for (long i = 0; i < count; i++, v += width)
        if (filter_correct(v, index) == 1)
            for (int j = 0; j < width; j++)
                v[j] = (real)NAN;
}

/* The readings of a sensor, one behind the other, and the results. */
typedef struct {
    const real *y, *R;
    real limit; /* of the NIS */
    real *innovation, *S, *nis;
} readings_of_sensor;

/* Steps of length dt, in which an input acts, one of some, with a sensor that is read behind it, less
 * than 0 for none, and its reading. Each begins at the belief after another one, -1 for the first
 * belief, which x and P have at first. Behind that they receive the belief after each step. The
 * number is returned of steps before a reading beyond its limit, or a belief that is not positive
 * definite.
 */
long filter_first(loop_state *s, long length, const real *dt, const long *input, const real *inputs,
                  const long *sensor, const long *start, const long *row,
                  readings_of_sensor *readings, real *first_x, real *first_P)
{
    for (long at = 0; at < length; at++) {
        real *x = first_x + (at + 1) * N, *P = first_P + (at + 1) * N * N;
        memcpy(x, first_x + (start[at] + 1) * N, N * sizeof *x);
        memcpy(P, first_P + (start[at] + 1) * N * N, N * N * sizeof *P);
        for (int j = 0; j < M; j++)
            s->input[j] = inputs[input[at] * M + j];
        if (dt[at] > 0 && (!predicted(s, dt[at], x, P) || !definite(x, P)))
            return at;
        if (sensor[at] < 0)
            continue;
        readings_of_sensor *of = readings + sensor[at];
        const int k = SENSOR[sensor[at]].size;
        correction c;
        const real *y = of->y + row[at] * k, *R = of->R + row[at] * k * k;
        if (!corrected(x, P, SENSOR + sensor[at], y, R, &c) || !(c.nis <= of->limit))
            return at;
        if (!definite(c.x, c.P))
            return at;
        memcpy(x, c.x, sizeof c.x);
        memcpy(P, c.P, sizeof c.P);
        memcpy(of->innovation, c.innovation, (size_t)k * sizeof *x);
        memcpy(of->S, c.S, (size_t)(k * k) * sizeof *x);
        *of->nis++ = c.nis;
        of->innovation += k, of->S += k * k;
    }
    return length;
}
