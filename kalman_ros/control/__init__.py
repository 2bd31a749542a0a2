# SPDX-License-Identifier: Apache-2.0
"""Optimal control of linear systems, and what theory predicts.

Imports name the module, ``from kalman_ros.control.lqr import lqr``, so that a node loads only
what it uses:

- systems: `state_space`, `delay`, `stability`, `structure`
- regulators: `lqr`, `placement`, `integral`, `tracking`
- estimators: `lqe`, `placement`
- closed loops: `compensator`, `separation`, `performance`, `margins`,
  `guarantee`, `recovery`
"""
