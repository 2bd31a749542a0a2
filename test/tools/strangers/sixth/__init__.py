# SPDX-License-Identifier: Apache-2.0
"""The sixth set of recordings: again other systems and faults."""
