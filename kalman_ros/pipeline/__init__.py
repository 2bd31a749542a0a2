# SPDX-License-Identifier: Apache-2.0
"""The path from the bytes of messages to beliefs and back, which node and replay share."""
