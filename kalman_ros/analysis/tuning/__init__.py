# SPDX-License-Identifier: Apache-2.0
"""Parameters from recordings, by maximum likelihood."""
