/* A belief corrected by a reading. */
typedef struct {
    real x[N], P[N * N], innovation[K_MOST], S[K_MOST * K_MOST], nis;
} correction;

/* z' S^-1 z, infinite where S is not positive definite; then 0 is returned */
static int weighed(const sensor *of, correction *c, real *L)
{
    real z[K_MOST];
    c->nis = INFINITY;
    if (!factored(c->S, of->size, 0, L))
        return 0;
    memcpy(z, c->innovation, sizeof z);
    solved(L, of->size, z);
    c->nis = 0;
    for (int i = 0; i < of->size; i++)
        c->nis += c->innovation[i] * z[i];
    if (!(c->nis >= 0))
        c->nis = INFINITY;
    return 1;
}
