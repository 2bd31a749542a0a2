# SPDX-License-Identifier: Apache-2.0
"""The third set of recordings: again other systems and faults; three are simulated by MuJoCo."""
