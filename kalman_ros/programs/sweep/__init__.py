# SPDX-License-Identifier: Apache-2.0
"""Maps of cost, errors and consistency over parameters."""
