# SPDX-License-Identifier: Apache-2.0
"""The twelfth set of recordings: again other systems and faults."""
