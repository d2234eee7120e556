// Entry of all reports: draws the data that the program left in the page, by its kind.
import './style.css';
import { comparisonReport } from './comparison';
import { evaluationReport } from './evaluation';
import { packingReport } from './packing';
import { runReport } from './run';
import { twoRunsReport } from './two_runs';
import { governor } from '../scene/governor';

const REPORTS = {
  run: runReport, two_runs: twoRunsReport, packing: packingReport, comparison: comparisonReport, evaluation: evaluationReport,
};

Object.assign(window, { palpate: { governor } }); // for tests, and for pictures in full detail

const data = JSON.parse(document.getElementById('data')!.textContent!);
const show = REPORTS[data.kind as keyof typeof REPORTS];
const main = document.createElement('main');
document.body.append(main);
void show(main, data);
