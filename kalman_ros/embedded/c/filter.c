/* What Python calls: a prediction and a correction of a belief, without time and gates. v holds x and
 * P, and behind them what each takes; where it succeeds 0 is returned, and v holds the results.
 */

/* behind P: the input */
int filter_predict(loop_state *s, real *v, real dt)
{
    for (int j = 0; j < M; j++)
        s->input[j] = v[N + N * N + j];
    return !predicted(s, dt, v, v + N);
}

/* as many beliefs, one behind the other; those without a finite result become NaN */
void filter_predict_many(loop_state *s, real *v, long count, real dt)
{
    for (long i = 0; i < count; i++, v += N + N * N + M)
        if (filter_predict(s, v, dt))
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
    return 0;
}

void filter_correct_many(real *v, long count, int index)
{
    const int k = SENSOR[index].size, width = N + N * N + k + k * k + 1;
    for (long i = 0; i < count; i++, v += width)
        if (filter_correct(v, index))
            for (int j = 0; j < width; j++)
                v[j] = (real)NAN;
}
