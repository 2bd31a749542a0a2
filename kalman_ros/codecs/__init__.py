# SPDX-License-Identifier: Apache-2.0
"""Message <-> vector: the only code that accesses the fields and stamps of messages."""
