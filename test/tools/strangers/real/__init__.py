# SPDX-License-Identifier: Apache-2.0
"""Real recordings, as they are and with a fault injected."""
