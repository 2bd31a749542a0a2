# SPDX-License-Identifier: Apache-2.0
"""Mathematics of matrices that estimation and control share; it knows none of our types."""
