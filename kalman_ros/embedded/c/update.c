/* A belief corrected by a reading. */
typedef struct {
    real x[N], P[N * N], innovation[K_MOST], S[K_MOST * K_MOST], nis;
} correction;

/* The numbers of a reading, with a bound that compilers see. */
INLINE int size_of(const sensor *of)
{
    return of->size < K_MOST ? of->size : K_MOST;
}

/* z' S^-1 z, infinite where S is not positive definite; then 0 is returned */
static int weighed(const sensor *of, correction *c, real *U)
{
    const int k = size_of(of);
    real z[K_MOST];
    c->nis = INFINITY;
    if (!factored(c->S, k, 0, U))
        return 0;
    memcpy(z, c->innovation, sizeof z);
    solved(U, k, 1, z);
    c->nis = 0;
    for (int i = 0; i < k; i++)
        c->nis += c->innovation[i] * z[i];
    if (!(c->nis >= 0))
        c->nis = INFINITY;
    return 1;
}
