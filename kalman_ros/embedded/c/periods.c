/* F, G and Q of a whole number of periods of a model in discrete time. */

static int sample(real dt, real *F, real *G, real *Q)
{
    real count = floor(dt / PERIOD + R(0.5)), last[N * N], G_last[N * M + 1], FQ[N * N];
    if (!(count <= MOST_PERIODS))
        return OVERFLOW_WITHIN;
    memset(F, 0, N * N * sizeof *F);
    memset(G, 0, N * M * sizeof *G);
    memset(Q, 0, N * N * sizeof *Q);
    for (int i = 0; i < N; i++)
        F[i * N + i] = 1;
    for (real k = 0; k < count; k += 1) {
        memcpy(last, F, sizeof last);
        memcpy(G_last, G, N * M * sizeof *G);
        for (int i = 0; i < N; i++) {
            for (int j = 0; j < M; j++) {
                G[i * M + j] = INPUT_MATRIX[i * M + j];
                for (int l = 0; l < N; l++)
                    G[i * M + j] += STATE_MATRIX[i * N + l] * G_last[l * M + j];
            }
            for (int j = 0; j < N; j++) {
                F[i * N + j] = 0;
                FQ[i * N + j] = 0;
                for (int l = 0; l < N; l++) {
                    F[i * N + j] += STATE_MATRIX[i * N + l] * last[l * N + j];
                    FQ[i * N + j] += STATE_MATRIX[i * N + l] * Q[l * N + j];
                }
            }
        }
        for (int i = 0; i < N; i++)
            for (int j = 0; j <= i; j++) {
                real sum = NOISE_COVARIANCE[i * N + j];
                for (int l = 0; l < N; l++)
                    sum += FQ[i * N + l] * STATE_MATRIX[j * N + l];
                Q[i * N + j] = sum;
                Q[j * N + i] = sum;
            }
    }
    return DONE;
}
