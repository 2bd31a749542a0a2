# SPDX-License-Identifier: Apache-2.0
"""Matrix mathematics shared by estimation and control; independent of the package's types."""
