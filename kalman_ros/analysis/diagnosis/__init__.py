# SPDX-License-Identifier: Apache-2.0
"""Why an estimate is wrong: from the arrays of a replay to findings, ranked."""
