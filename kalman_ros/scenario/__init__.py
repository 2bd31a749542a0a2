# SPDX-License-Identifier: Apache-2.0
"""From named values, as parameter files have them, to the objects of one scenario."""
