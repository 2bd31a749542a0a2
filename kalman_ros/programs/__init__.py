# SPDX-License-Identifier: Apache-2.0
"""Programs for people, as opposed to nodes."""
