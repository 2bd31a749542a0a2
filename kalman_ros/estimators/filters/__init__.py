# SPDX-License-Identifier: Apache-2.0
"""The filters, one a file: the file's name is the filter's name, and ``FILTER`` is its class.

A new file is all that a new filter needs: parameters, help, nodes, replays, studies and tests
list these files, and the class says what else they have to know.
"""
