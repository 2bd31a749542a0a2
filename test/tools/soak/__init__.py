# SPDX-License-Identifier: Apache-2.0
"""A long run in real time with faults: memory, deadlines, lost messages."""
