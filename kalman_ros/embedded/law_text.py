# SPDX-License-Identifier: Apache-2.0
"""The C of a law: gains, limits, set points."""

from __future__ import annotations

from kalman_ros.scenario.regulator import BEYOND

from .expressions import number, numbers
from .loop import LONGEST_PASSED, Law
from .texts import addition, difference, text

#: A step of the law of this many seconds or more is refused.
_LONGEST = 60.0
#: Declarations of a law's functions in the header.
FUNCTIONS = """
/* Hold a state of the model from now on, if an input holds it there. That the estimate restarts
 * does not change what is held.
 */
NAME_outcome NAME_hold(NAME_loop *loop, const NAME_real *reference);

/* The input u for the estimate, within its limits, dt seconds after the last call; it acts. With
 * dt = 0 the rate limit allows for a period of the loop; dt below 0 or of 60 s or more is refused,
 * and u stays as it was. Integral and motion count half a second at most. Where u would not be
 * finite, it goes to the idle input.
 */
NAME_outcome NAME_control(NAME_loop *loop, NAME_real dt, NAME_real *u);

/* The input u towards the idle one, within its rate limit; it acts. The law goes on from there,
 * without what it had integrated.
 */
void NAME_idle(NAME_loop *loop, NAME_real dt, NAME_real *u);
"""
#: The same of a motion.
_FOLLOW = """
/* Follow the motion, which takes {seconds:.4g} s, from its beginning. Its last state is held after
 * its end; NAME_hold ends it before. Its time is the sum of the dt of NAME_control from the second
 * call on.
 */
void NAME_follow(NAME_loop *loop);
"""
#: The calls of check.c, and the one that it takes the time of.
CASES = """\
        case 'H': outcome = NAME_hold(&loop, given); break;
        case 'U': outcome = NAME_control(&loop, given[0], u); break;
        case 'O': NAME_idle(&loop, given[0], u); break;"""
_FOLLOWED = """
        case 'M': NAME_follow(&loop); break;"""
_TIMED = '            NAME_control(&loop, (NAME_real){dt!r}, u);'


def functions(law: Law) -> str:
    """Return the declarations of a law's functions."""
    motion = law.motion
    return FUNCTIONS + ('' if motion is None else _FOLLOW.format(seconds=motion.duration))


def cases(law: Law) -> str:
    """Return the calls of check.c."""
    return CASES + ('' if law.motion is None else _FOLLOWED)


def law_texts(law: Law, rate: float) -> list[str]:
    """Return the texts of a law that acts at a ``rate``, in 1/s."""
    feedback, limits = law.feedback, law.limits
    texts = [
        f'#define LAW\n#define N_MODEL {law.space.size}\n#define STEP {1.0 / rate!r}\n',
        f'#define LONGEST {number(_LONGEST)}\n#define LONGEST_PASSED {number(LONGEST_PASSED)}\n',
        f'#define BEYOND {number(BEYOND)}\n',
        numbers('GAIN', feedback.gain),
        numbers('REST_STATE', law.rest.state),
        numbers('REST_INPUT', law.rest.input),
        numbers('STATE_GAIN', law.equilibria.state_gain),
        numbers('INPUT_GAIN', law.equilibria.input_gain),
        numbers('LOWER', limits.lower),
        numbers('UPPER', limits.upper),
        numbers('RATE', limits.rate),
        difference('model_difference', law.space),
    ]
    if feedback.tracked:
        listed = ', '.join(map(str, feedback.tracked))
        texts += [
            f'#define TRACKED {len(feedback.tracked)}\n'
            f'static const int PLACES[] = {{{listed}}};\n',
            numbers('INTEGRAL_GAIN', feedback.integral_gain),
        ]
    if law.blend:
        texts.append(f'#define BLEND {number(law.blend)}\n')
    return [*texts, *_motion_texts(law), text('law.c')]


def _motion_texts(law: Law) -> list[str]:
    """Return the table of a motion: states, inputs and gains, a row a step."""
    motion = law.motion
    if motion is None:
        return []
    gains = () if motion.gains is None else (motion.gains,)
    return [
        f'#define MOTION\n#define LAST_STEP {len(motion.states) - 1}\n'
        f'#define MOTION_STEP {motion.dt!r}\n#define DURATION {motion.duration!r}\n',
        numbers('MOTION_STATE', motion.states),
        numbers('MOTION_INPUT', motion.inputs),
        *(f'#define MOTION_GAINS\n{numbers("MOTION_GAIN", table)}' for table in gains),
        addition('model_sum', law.space),
    ]


def fields(law: Law) -> str:
    """Return what the struct has for a law."""
    n, m, p = law.space.size, law.rest.input.size, len(law.feedback.tracked)
    integral = f'    NAME_real integral[{p}]; /* of the errors of tracked states */\n'
    blend = (
        f'    NAME_real jump[{m}], last[{n}]; /* what decays, and the state of the last input */\n'
    )
    motion = (
        '    double elapsed;   /* s since the motion began */\n'
        '    int32_t row;      /* of its gains; -1: those of the law */\n'
        '    int8_t following; /* 1 at its beginning, 2 on the way, else 0 */\n'
    )
    return (
        f'    NAME_real state[{n}], held[{m}]; /* what is held, and the input that holds it */\n'
        f'    NAME_real output[{m}];          /* the last input, within its limits */\n'
        f'{integral if p else ""}{blend if law.blend else ""}'
        f'{"" if law.motion is None else motion}'
        '    int8_t begun, released; /* whether the law has acted, and u has been idle since */\n'
    )


def timed(rate: float) -> str:
    """Return the call that check.c takes the time of."""
    return _TIMED.format(dt=1.0 / rate)
