# SPDX-License-Identifier: Apache-2.0
"""The nodes: thin wrappers that declare parameters and connect objects to topics."""
