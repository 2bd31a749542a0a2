"""Options that are infinite, as a limit that there is not, are no parameters to fit."""

import pytest

from kalman_ros.analysis.tuning.named_parameters import NamedParameters
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file


@pytest.mark.parametrize(('limits', 'fitted'), [([1.0, 2.0, 3.0], 3), (None, 0)])
def test_a_limit_that_is_infinite_is_not_fitted(limits, fitted):
    given = {} if limits is None else {'model_parameters.acceleration_limits': limits}
    values = {**from_file(shipped.file('robot_2d'), 'estimator'), **given}
    names = [name for name in NamedParameters(values).names if 'acceleration_limits' in name]
    assert len(names) == fitted
