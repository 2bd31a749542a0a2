# SPDX-License-Identifier: Apache-2.0
"""From the bytes of messages to beliefs and back to bytes: what node and replay share."""
