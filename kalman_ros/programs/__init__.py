# SPDX-License-Identifier: Apache-2.0
"""Programs that a person runs and that are not nodes."""
