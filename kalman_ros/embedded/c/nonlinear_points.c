/* A point after a step. */
static int moved_by(loop_state *s, const real *x, const real *u, real dt, real *moved)
{
    (void)s;
    advance(x, u, dt, MAX_STEP, NUMBERS, moved, 0);
    return DONE;
}
