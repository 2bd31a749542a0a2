# SPDX-License-Identifier: Apache-2.0
"""From the sound at several microphones to the direction that it comes from."""
