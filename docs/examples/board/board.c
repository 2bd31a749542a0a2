/* The start of a Cortex-M4, and a loop that a timer's interrupt would run.
 *
 * A cart that the same model moves stands for the real one. SysTick counts what a step takes.
 */

#include "cart_pole.h"

#include <stdint.h>
#include <stdio.h>

extern char stack_top;
extern void _start(void); /* of the C library: its output goes to the debugger */
void reset(void), _init(void), _fini(void);

/* Nothing is constructed. */
void _init(void) {}
void _fini(void) {}

/* The floating point unit is off after a reset. */
void reset(void)
{
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20;
    __asm__ volatile("dsb; isb");
    _start();
}

static void stop(void)
{
    for (;;)
        ;
}

__attribute__((section(".vectors"), used)) static void *const vectors[16] = {
    &stack_top, (void *)reset, (void *)stop, (void *)stop, (void *)stop, (void *)stop, (void *)stop,
};

#define SYSTICK ((volatile uint32_t *)0xE000E010u)

/* The loop, and a second one that stands for the cart: it is predicted and never corrected. */
static cart_pole_loop loop, cart;

/* What the interrupt does, every 10 ms: one step of the loop. */
static void tick(const float encoders[2], float force[1])
{
    (void)cart_pole_predict(&loop, 0.01f);
    (void)cart_pole_correct_joint_states(&loop, encoders, 0);
    (void)cart_pole_control(&loop, 0.01f, force);
}

int main(void)
{
    float force[1] = {0};
    uint32_t most = 0;
    cart_pole_init(&loop);
    cart_pole_init(&cart);
    cart.x[CART_POLE_X_x] = 0.1f;
    cart.x[CART_POLE_X_theta] = 0.05f;
    SYSTICK[1] = 0xFFFFFFu;
    SYSTICK[0] = 5u; /* on, by the processor's clock */
    for (int k = 0; k < 1000; k++) {
        const float encoders[2] = {cart.x[CART_POLE_X_x], cart.x[CART_POLE_X_theta]};
        const uint32_t before = SYSTICK[2];
        tick(encoders, force);
        const uint32_t took = (before - SYSTICK[2]) & 0xFFFFFFu;
        if (took > most)
            most = took;
        (void)cart_pole_input(&cart, force);
        (void)cart_pole_predict(&cart, 0.01f);
        if (k % 200 == 0)
            printf("%4.1f s: cart %7.4f m, pole %7.4f rad, force %6.3f N\n", 0.01 * k,
                   (double)encoders[0], (double)encoders[1], (double)force[0]);
    }
    printf("a step takes %lu ticks of the processor's timer at most\n", (unsigned long)most);
    return 0;
}
