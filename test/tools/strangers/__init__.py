# SPDX-License-Identifier: Apache-2.0
"""Recordings of robots that know nothing of the package, each with a fault that is known."""
