# SPDX-License-Identifier: Apache-2.0
"""The ninth set of recordings: again other systems and faults."""
