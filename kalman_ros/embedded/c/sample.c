/* F, G and Q of a step by the flow of the state with its input behind it, which rests:
 * C. Van Loan, Computing Integrals Involving the Matrix Exponential, IEEE Trans. Automatic Control
 * 23(3), 1978.
 */

static int sample(real dt, real *F, real *G, real *Q)
{
    real whole[ORDER * ORDER], noise[ORDER * ORDER];
    if (flow(0, 0, dt, 0, whole, noise, 1) != DONE)
        return OVERFLOW_WITHIN;
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < N; j++) {
            F[i * N + j] = whole[i * ORDER + j];
            Q[i * N + j] = noise[i * ORDER + j];
        }
        for (int j = 0; j < M; j++)
            G[i * M + j] = whole[i * ORDER + N + j];
    }
    return DONE;
}
