# SPDX-License-Identifier: Apache-2.0
"""The fifth set of recordings: again other systems and faults."""
