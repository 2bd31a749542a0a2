# SPDX-License-Identifier: Apache-2.0
"""The eleventh set of recordings: again other systems and faults."""
