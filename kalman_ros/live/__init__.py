# SPDX-License-Identifier: Apache-2.0
"""Live page and viewers, which show the running nodes and change their parameters."""
