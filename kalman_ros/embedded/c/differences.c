/* The derivative of a sensor by central differences, where its formula has no finite one. */
static void differenced(const real *x, int k, void (*measure)(const real *, real *),
                        void (*difference)(const real *, const real *, real *), real *H)
{
    real at[N], above[K_MOST], below[K_MOST], change[K_MOST];
    memcpy(at, x, sizeof at);
    for (int j = 0; j < N; j++) {
        const real h = DIFFERENCE * fmax((real)1, fabs(x[j]));
        at[j] = x[j] + h;
        measure(at, above);
        at[j] = x[j] - h;
        measure(at, below);
        at[j] = x[j];
        difference(above, below, change);
        for (int i = 0; i < k; i++)
            H[i * N + j] = change[i] / (2 * h);
    }
}
