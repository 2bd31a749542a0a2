# SPDX-License-Identifier: Apache-2.0
"""The controller: an estimate in, the input that responds to it out."""
