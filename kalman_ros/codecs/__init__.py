# SPDX-License-Identifier: Apache-2.0
"""Message <-> vector: the only place that knows the fields of messages, and their stamps."""
