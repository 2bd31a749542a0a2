/* What is known of a sensor. */
typedef struct {
    int size;                                             /* the numbers of a reading */
    const real *covariance;                               /* the configured one */
    real gate;                                            /* the largest NIS that is fused */
    void (*measure)(const real *x, real *y);
    void (*jacobian)(const real *x, real *H);             /* row by row */
    void (*difference)(const real *a, const real *b, real *d);
    const real *gain;                                     /* a fixed one, or 0 */
    const signed char *angles;                            /* which numbers are angles */
} sensor;
