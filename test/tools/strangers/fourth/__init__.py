# SPDX-License-Identifier: Apache-2.0
"""The fourth set of recordings: again other systems and faults."""
