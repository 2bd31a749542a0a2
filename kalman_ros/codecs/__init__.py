# SPDX-License-Identifier: Apache-2.0
"""Conversion between messages and vectors: no other code accesses fields and stamps."""
