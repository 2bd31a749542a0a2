# SPDX-License-Identifier: Apache-2.0
"""`doctor`: what is wrong with a recording and its parameters, with its proof."""
