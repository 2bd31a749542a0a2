# SPDX-License-Identifier: Apache-2.0
"""Conversion of messages to vectors: the only code that accesses their fields and stamps."""
