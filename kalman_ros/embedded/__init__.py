# SPDX-License-Identifier: Apache-2.0
"""A designed loop as C99: estimator, law and limits for a processor without Python."""
