# SPDX-License-Identifier: Apache-2.0
"""The second set of recordings: other systems and other faults, in the same form as the first."""
