# SPDX-License-Identifier: Apache-2.0
"""Reading, writing and replay of recordings, without middleware."""
