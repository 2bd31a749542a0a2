# SPDX-License-Identifier: Apache-2.0
"""A page that shows the running nodes and changes their parameters."""
