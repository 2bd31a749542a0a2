# SPDX-License-Identifier: Apache-2.0
"""The tenth set of recordings: again other systems and faults."""
