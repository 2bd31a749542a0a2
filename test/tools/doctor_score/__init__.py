# SPDX-License-Identifier: Apache-2.0
"""Score of the diagnosis on recordings with faults that are injected into our simulations."""
