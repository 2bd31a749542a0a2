# SPDX-License-Identifier: Apache-2.0
"""Recordings of shipped scenarios by the package's simulation, with the faults of its injector."""
